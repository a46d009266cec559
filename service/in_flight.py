"""Counts of each tenant's operations in flight at this process."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager


class InFlight:
    """Counter of operations in flight; limits are left to its users."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def count(self, tenant: str) -> int:
        """Number of a tenant's operations."""
        return self._counts[tenant]

    def total(self) -> int:
        """Number of all tenants' operations."""
        return self._counts.total()

    @contextmanager
    def counted(self, tenant: str) -> Iterator[None]:
        """Count one more operation of a tenant during the block."""
        self._counts[tenant] += 1
        try:
            yield
        finally:
            self._counts[tenant] -= 1
            if not self._counts[tenant]:
                del self._counts[tenant]
