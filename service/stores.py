"""What the command line does with the artifact store: check at start whose it is, and hand it over."""

import sys
from contextlib import closing

from service.config import Settings
from service.jobs.artifacts import StoreUnavailableError
from service.jobs.ledger import Ledger
from service.jobs.ownership import ForeignStoreError, adopt, claim
from service.jobs.stores import open_store


def require_own_store(settings: Settings) -> None:
    """Claim the store for the ledger.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where it is another's or does not answer.
    """
    with closing(Ledger(settings.ledger_url)) as ledger:
        try:
            claim(ledger, open_store(settings))
        except ForeignStoreError as error:
            print(error, file=sys.stderr)
        except StoreUnavailableError as error:
            print(error.message, "Check MESHMARK_STORE_URL and its keys, or the folder's disk.", file=sys.stderr)
        else:
            return
    sys.exit(2)


def run_adopt_store(settings: Settings) -> int:
    """Hand the store over to the ledger, whosever it was; returns the exit code."""
    with closing(Ledger(settings.ledger_url)) as ledger:
        store = open_store(settings)
        before = store.owner()
        adopt(ledger, store)
        print(f"{store} belongs to the database {ledger.identity} now; before, to {before or 'none'}.")
    return 0
