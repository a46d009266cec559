"""What outbound requests may reach and how long they may take."""

from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network

PORTS = frozenset({80, 443})


@dataclass(frozen=True)
class Policy:
    """Where requests may go.

    Attributes:
        allow: networks that are reached though they are not public.
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
