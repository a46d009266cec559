"""What the command line does with the artifact store: check at start whose it is, and hand it over."""

import sys
import time
from collections.abc import Callable
from contextlib import closing

from sqlalchemy.exc import OperationalError

from service.config import Settings
from service.jobs.artifacts import StoreUnavailableError
from service.jobs.ledger import Ledger, UnusableLedgerError
from service.jobs.ownership import ForeignStoreError, adopt, claim
from service.jobs.stores import open_store
from service.webhooks.vault import UnreadableSecretError, Vault, read_keys, renew_secrets

PATIENCE, PAUSE = 60.0, 1.0  # seconds


def require_own_store(settings: Settings, patience: float = PATIENCE) -> None:
    """Claim the store for the ledger; where one of them does not answer, it is waited for: it may only be restarted.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where the store is another's, the ledger can be none, or one
            of them has not answered for so long.
    """
    _require(settings, lambda ledger: claim(ledger, open_store(settings)), patience)


def require_secrets(settings: Settings, patience: float = PATIENCE) -> None:
    """Encrypt the secrets of webhooks with the key that there is, for who needs them; a ledger is waited for likewise.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where one is encrypted with a key that is not known here.
    """
    vault = Vault(read_keys(settings.secrets_key))
    _require(settings, lambda ledger: renew_secrets(ledger.sessions, vault), patience)


def _require(settings: Settings, check: Callable[[Ledger], None], patience: float) -> None:
    deadline = time.monotonic() + patience
    while True:
        try:
            with closing(Ledger(settings.ledger_url)) as ledger:
                return check(ledger)
        except (ForeignStoreError, UnusableLedgerError, UnreadableSecretError) as error:
            sys.exit(_failed(str(error)))
        except StoreUnavailableError as error:
            if time.monotonic() >= deadline:
                sys.exit(_failed(f"{error.message} Check MESHMARK_STORE_URL and its keys, or the folder's disk."))
        except OperationalError as error:
            if time.monotonic() >= deadline:
                sys.exit(_failed(no_database(error)))
        time.sleep(PAUSE)


def no_database(error: OperationalError) -> str:
    """A sentence about a database that does not answer."""
    return f"The database does not answer: {' '.join(str(error.orig).split())} Check MESHMARK_DATABASE_URL."


def _failed(sentence: str) -> int:
    print(sentence, file=sys.stderr)
    return 2


def run_adopt_store(settings: Settings) -> int:
    """Hand the store over to the ledger, whosever it was; returns the exit code."""
    with closing(Ledger(settings.ledger_url)) as ledger:
        store = open_store(settings)
        before = store.owner()
        adopt(ledger, store)
        print(f"{store} belongs to the database {ledger.identity} now; before, to {before or 'none'}.")
    return 0
