"""Slots of a webhook sender, limited for each tenant so that those with slow receivers do not hold all of them."""

import threading
from collections import Counter


class Slots:
    """Slots with a dynamic threshold (Choudhury and Hahne, 1998): a tenant holds no more than are free.

    One tenant alone gets half of them, and n tenants at their limit the n+1st part each; as much stays free for the
    next one.
    """

    def __init__(self, number: int) -> None:
        self._free, self._held = number, Counter[str]()
        self._lock = threading.Lock()

    def acquire(self, tenant: str) -> bool:
        """Acquire a slot for a tenant, to be released; False where it holds as many as are free."""
        with self._lock:
            if self._held[tenant] >= self._free:
                return False
            self._held[tenant] += 1
            self._free -= 1
            return True

    def release(self, tenant: str) -> None:
        """Release a slot of a tenant."""
        with self._lock:
            self._held[tenant] -= 1
            self._free += 1
            self._held += Counter()  # drops tenants that hold none
