"""Ownership of the artifact store. It belongs to one ledger alone, as content that this ledger has no reference to is
deleted.

A marker in the store names its ledger. It is written when the store is first used, and only if there is none, so of two
concurrent ledgers one gets the store. A store that has content and no marker (from before there were markers, or copied
without) is taken over only if the ledger refers to everything in it: then nothing can be lost. In every other case of
doubt nothing is deleted, and the operator decides.
"""

from itertools import islice

from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Ledger
from service.jobs.references import unreferenced

PAGE = 500  # hashes in one query

REMEDY = (
    "Name the database that belongs to this store (MESHMARK_DATABASE_URL), or give this one a store of its own "
    "(MESHMARK_STORE_URL, MESHMARK_DATA_DIR). If the store's own database is lost for good, `python -m service "
    "adopt-store` hands the store over: what this database does not refer to is then deleted."
)


class ForeignStoreError(Exception):
    """The store is another ledger's, or may be."""


def claim(ledger: Ledger, store: ArtifactStore) -> None:
    """Check that the store is this ledger's, and mark it as such where it has no owner.

    Raises:
        ForeignStoreError: it is another's, or has content that this ledger knows nothing of.
        StoreUnavailableError: the store does not answer.
    """
    owner = store.owner()
    if owner is None:
        if _has_unknown_content(ledger, store):
            raise ForeignStoreError(
                f"{store} has no mark that says which database it belongs to, and holds content that this one "
                f"({ledger.identity}) does not refer to. {REMEDY}"
            )
        store.mark(ledger.identity)
        owner = store.owner()  # of two at once, one was first
    if owner != ledger.identity:
        raise ForeignStoreError(f"{store} belongs to the database {owner}, and this one is {ledger.identity}. {REMEDY}")


def adopt(ledger: Ledger, store: ArtifactStore) -> None:
    """Take a store over, whichever ledger owns it.

    Raises:
        StoreUnavailableError: the store does not answer.
    """
    store.unmark()
    store.mark(ledger.identity)


def _has_unknown_content(ledger: Ledger, store: ArtifactStore) -> bool:
    hashes = (item.sha256 for item in store.listing())
    while page := list(islice(hashes, PAGE)):
        if unreferenced(ledger.sessions, page):
            return True
    return False
