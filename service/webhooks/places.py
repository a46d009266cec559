"""Who may hold how many of a sender's places, so that tenants whose receivers are slow do not hold all of them."""

import threading
from collections import Counter


class Places:
    """Places that are given by dynamic thresholds (Choudhury and Hahne, 1998): to each tenant no more than are free.

    One tenant alone gets half of them, and n tenants who take what they can the n+1st part each; as much stays free for
    whoever comes next.
    """

    def __init__(self, number: int) -> None:
        self._free, self._held = number, Counter[str]()
        self._lock = threading.Lock()

    def take(self, tenant: str) -> bool:
        """A place for a tenant, to be given back; False where they hold as many as are free."""
        with self._lock:
            if self._held[tenant] >= self._free:
                return False
            self._held[tenant] += 1
            self._free -= 1
            return True

    def give_back(self, tenant: str) -> None:
        """A place is free again."""
        with self._lock:
            self._held[tenant] -= 1
            self._free += 1
            self._held += Counter()  # without those who hold none
