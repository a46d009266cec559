"""Rate limit of requests without a key, by the address that they come from, in the memory of one API process."""

import threading
from collections import OrderedDict
from ipaddress import IPv6Address, ip_address

MINUTE = 60.0  # seconds
QUESTIONS = 20  # about each verification that an address may send
MOST = 10_000  # addresses that are remembered
NETWORK = 64  # leading bits of an IPv6 address that count as one client's


class AddressLimit:
    """Buckets of a minute's requests, one for each address, that fill evenly: see :func:`service.jobs.limits.spend`.

    Of too many addresses, those are forgotten whose last request is longest ago. Who has more of them than are
    remembered is not held up by a limit for each anyway.

    Args:
        per_minute: requests a minute.
    """

    def __init__(self, per_minute: int) -> None:
        self._share = MINUTE / per_minute
        self._full_at: OrderedDict[str, float] = OrderedDict()  # seconds; those whose last request is oldest first
        self._lock = threading.Lock()

    def spend(self, client: str, moment: float) -> float:
        """Take a request of a client; returns 0, or the seconds until there is one to take.

        Args:
            client: as :func:`client_of` names it.
            moment: of a monotonic clock, seconds.
        """
        with self._lock:
            full_at = max(self._full_at.get(client, moment), moment)
            if (wait := full_at + self._share - moment - MINUTE) > 0:
                return wait
            self._full_at[client] = full_at + self._share
            self._full_at.move_to_end(client)
            if len(self._full_at) > MOST:
                self._full_at.popitem(last=False)
            return 0.0


class PublicLimits:
    """Limits of requests without a key: of verifications, and of questions about them.

    Args:
        per_minute: verifications a minute from one address.
    """

    def __init__(self, per_minute: int) -> None:
        self.verifications = AddressLimit(per_minute)
        self.questions = AddressLimit(QUESTIONS * per_minute)


def client_of(host: str) -> str:
    """Client that an address stands for: itself, or the /64 network of an IPv6 one, which usually is one client's."""
    try:
        address = ip_address(host)
    except ValueError:  # a name, as of a Unix socket
        return host
    if isinstance(address, IPv6Address):
        mapped = address.ipv4_mapped
        return str(mapped) if mapped else f"{int(address) >> (128 - NETWORK):x}/{NETWORK}"
    return str(address)
