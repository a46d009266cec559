"""Commands and checks of the artifact store: claim it for the ledger at start, and hand it over."""

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

TIMEOUT, PAUSE = 60.0, 1.0  # seconds to wait for ledger and store in all, and between two attempts


def require_own_store(settings: Settings, timeout: float = TIMEOUT) -> None:
    """Claim the store for the ledger; retry while one of them does not answer, as it may be restarting.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where the store is another's, the database can be no ledger,
            or one of them has not answered for `timeout` seconds.
    """
    _require(settings, lambda ledger: claim(ledger, open_store(settings)), timeout)


def require_secrets(settings: Settings, timeout: float = TIMEOUT) -> None:
    """Encrypt the stored secrets of webhooks with the current key, for processes that use them; retry likewise.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where one is encrypted with a key that is not known here.
    """
    vault = Vault(read_keys(settings.secrets_key))
    _require(settings, lambda ledger: renew_secrets(ledger.sessions, vault), timeout)


def _require(settings: Settings, check: Callable[[Ledger], None], timeout: float) -> None:
    deadline = time.monotonic() + timeout
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
    """Sentence about a database that does not answer."""
    return f"The database does not answer: {' '.join(str(error.orig).split())} Check MESHMARK_DATABASE_URL."


def _failed(sentence: str) -> int:
    print(sentence, file=sys.stderr)
    return 2


def run_adopt_store(settings: Settings) -> int:
    """Hand the store over to the ledger, whichever ledger had it; returns the exit code."""
    with closing(Ledger(settings.ledger_url)) as ledger:
        store = open_store(settings)
        before = store.owner()
        adopt(ledger, store)
        print(f"{store} belongs to the database {ledger.identity} now; before, to {before or 'none'}.")
    return 0
