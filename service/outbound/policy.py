"""Policy and time-outs of outbound requests."""

from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network

PORTS = frozenset({80, 443})  # permitted by default


@dataclass(frozen=True)
class Policy:
    """Destinations that outbound requests may have.

    Attributes:
        allow: networks that are permitted though they are not public.
        schemes: of `https` and `http`, those accepted.
        ports: those accepted.
    """

    allow: tuple[IPv4Network | IPv6Network, ...] = ()
    schemes: frozenset[str] = frozenset({"https"})
    ports: frozenset[int] = PORTS


@dataclass(frozen=True)
class Timeouts:
    """Seconds: to connect to one address, of silence while reading or writing, and for the whole exchange."""

    connect: float = 5.0
    silence: float = 10.0
    total: float = 60.0
