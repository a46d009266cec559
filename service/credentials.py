"""The operator's side of Content Credentials: the key and its chain, and a chain for tests."""

import argparse
import os
import sys
from pathlib import Path

from cryptography.x509 import load_pem_x509_certificates

from core.credentials.chain import Chain, UnusableChainError, read_chain, self_signed
from service.config import Settings
from service.jobs.clock import now

CHAIN, KEY = "c2pa-chain.pem", "c2pa-key.pem"
PROVES_NOTHING = (
    "This chain is signed by itself: it proves nothing to anybody else. Use it for tests, and have a certificate "
    "authority of the C2PA trust list sign one for what you publish."
)


def require_chain(settings: Settings) -> Chain:
    """The key and the chain of the settings, checked.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where nothing can be signed with them.
    """
    try:
        if settings.c2pa_chain is None or settings.c2pa_key is None:
            raise UnusableChainError("A signer needs MESHMARK_C2PA_CHAIN and MESHMARK_C2PA_KEY.")
        return read_chain(settings.c2pa_chain.read_bytes(), settings.c2pa_key.read_bytes(), now())
    except OSError as error:
        reason = f"{error.filename} cannot be read ({error.strerror})."
    except UnusableChainError as error:
        reason = str(error)
    print(f"Content Credentials: {reason} Check MESHMARK_C2PA_CHAIN and MESHMARK_C2PA_KEY.", file=sys.stderr)
    sys.exit(2)


def require_trust(settings: Settings) -> None:
    """Check that the certificates are there which verifications trust.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where they cannot be read.
    """
    if settings.c2pa_trust is None:
        return
    try:
        load_pem_x509_certificates(settings.c2pa_trust.read_bytes())
    except OSError as error:
        reason = f"{error.filename} cannot be read ({error.strerror})."
    except ValueError:
        reason = f"{settings.c2pa_trust} holds no certificates in PEM."
    else:
        return
    print(f"Content Credentials: {reason} Check MESHMARK_C2PA_TRUST.", file=sys.stderr)
    sys.exit(2)


def add_credentials_commands(parser: argparse.ArgumentParser) -> None:
    """Add the commands."""
    commands = parser.add_subparsers(dest="credentials", required=True)
    make = commands.add_parser("self-signed", help="make a key and a chain for tests")
    make.add_argument("folder", type=Path, help=f"where {KEY} and {CHAIN} are written")


def run_credentials_command(arguments: argparse.Namespace) -> int:
    """Write a key, for its owner alone, and its chain; returns the exit code: 2 where one of the files is there."""
    folder: Path = arguments.folder
    chain = self_signed(now())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder / KEY, chain.key, 0o600)
        _write(folder / CHAIN, chain.certificates, 0o644)
    except OSError as error:
        print(f"{error.filename} cannot be written ({error.strerror}).", file=sys.stderr)
        return 2
    print(f"MESHMARK_C2PA_KEY={folder / KEY}\nMESHMARK_C2PA_CHAIN={folder / CHAIN}")
    print(PROVES_NOTHING, file=sys.stderr)
    return 0


def _write(path: Path, content: bytes, mode: int) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
