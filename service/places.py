"""How many of something each tenant has under way at this process."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager


class Places:
    """Counts what is under way; what is too much, those who take places decide."""

    def __init__(self) -> None:
        self._taken: Counter[str] = Counter()

    def count(self, tenant: str) -> int:
        """How many a tenant has."""
        return self._taken[tenant]

    def total(self) -> int:
        """How many all have."""
        return self._taken.total()

    @contextmanager
    def taken(self, tenant: str) -> Iterator[None]:
        """One more of a tenant's."""
        self._taken[tenant] += 1
        try:
            yield
        finally:
            self._taken[tenant] -= 1
            if not self._taken[tenant]:
                del self._taken[tenant]
