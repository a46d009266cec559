"""`python -m service keys`: create, list and revoke API keys."""

import argparse
import sys
from datetime import datetime, timedelta

from service.config import Settings
from service.jobs.clock import now
from service.jobs.ledger import Ledger
from service.jobs.models import DEFAULT_TENANT
from service.jobs.tenants import Scope, create_key, list_keys, revoke_key


def add_keys_commands(parser: argparse.ArgumentParser) -> None:
    """Add the commands to a parser."""
    commands = parser.add_subparsers(dest="action", required=True)
    create = commands.add_parser("create", help="print a new key; it is not shown again")
    create.add_argument("--tenant", default=DEFAULT_TENANT, help="whose it is; created with the first key")
    create.add_argument("--name", required=True, type=_name, help="what it is for")
    create.add_argument("--scope", action="append", choices=[*Scope], help="what it is good for; may be repeated; all")
    create.add_argument("--days", type=_days, help="how long it is good; for ever")
    listing = commands.add_parser("list", help="print what keys there are")
    listing.add_argument("--tenant", help="only this tenant's")
    revoke = commands.add_parser("revoke", help="end a key at once")
    revoke.add_argument("id", help="the eight characters after mm_")


def run_keys_command(settings: Settings, arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    ledger = Ledger(settings.ledger_url)
    try:
        match arguments.action:
            case "create":
                expiry = now() + timedelta(days=arguments.days) if arguments.days else None
                scopes = arguments.scope or [*Scope]
                print(create_key(ledger.sessions, arguments.tenant, arguments.name, scopes, expiry).text)
            case "list":
                for key in list_keys(ledger.sessions, arguments.tenant):
                    state = "revoked" if key.revoked_at else "expired" if _past(key.expires_at) else "active"
                    used = f"used {key.last_used_at:%Y-%m-%d}" if key.last_used_at else "never used"
                    until = f"until {key.expires_at:%Y-%m-%d}" if key.expires_at else "for ever"
                    print(key.id, key.tenant_id, state, ",".join(key.scopes), until, used, key.name, sep="\t")
            case "revoke":
                if not revoke_key(ledger.sessions, arguments.id):
                    print(f"There is no key {arguments.id} that works.", file=sys.stderr)
                    return 1
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        ledger.close()
    return 0


def _name(text: str) -> str:
    if not text.isprintable() or not 1 <= len(text) <= 100:
        raise argparse.ArgumentTypeError("it has 1 to 100 characters")
    return text


def _days(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 36500:
        raise argparse.ArgumentTypeError("it is a number from 1 to 36500")
    return int(text)


def _past(moment: datetime | None) -> bool:
    return moment is not None and moment <= now()
