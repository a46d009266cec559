"""URLs that users give, parsed and checked."""

import re
from dataclasses import dataclass
from ipaddress import ip_address

import httpx2

from service.outbound.addresses import Address
from service.outbound.errors import address_refused
from service.outbound.policy import Policy

LONGEST_URL = 2048  # characters
LONGEST_NAME = 253  # characters of a host name: RFC 1035, 2.3.4
DEFAULT_PORTS = {"http": 80, "https": 443}
NAME = re.compile(r"(?!-)[a-z0-9_-]{1,63}(?<!-)(\.(?!-)[a-z0-9_-]{1,63}(?<!-))*")
# A host that ends like this is read as an IPv4 address by some programs: 2130706433, 0x7f.1, 0177.0.0.1.
# WHATWG URL, "ends in a number checker".
NUMBER_AT_END = re.compile(r"(^|\.)([0-9]+|0x[0-9a-f]*)$")


@dataclass(frozen=True)
class Target:
    """Parsed URL; `address` is set where the host is an IP address, `authority` is for the field `Host`."""

    scheme: str
    host: str
    address: Address | None
    port: int
    path: str
    authority: str


def parse_target(url: str, policy: Policy) -> Target:
    """Parse a URL.

    Raises:
        MeshmarkError: ``address_refused`` when it is no URL, or asks for a scheme, a port or a host that is not served,
            or carries a user name or password.
    """
    if len(url) > LONGEST_URL:
        raise address_refused(f"The address is longer than {LONGEST_URL:,} characters.")
    try:
        parsed = httpx2.URL(url)
        host, authority = parsed.raw_host.decode("ascii"), parsed.netloc.decode("ascii")
        path = parsed.raw_path.decode("ascii")
    except (httpx2.InvalidURL, UnicodeError):
        raise address_refused("The address is not a valid URL.") from None
    if parsed.scheme not in policy.schemes:
        raise address_refused(f"The address does not begin with {' or '.join(sorted(policy.schemes))}://.")
    if parsed.userinfo:
        raise address_refused(
            "The address carries a user name or a password.", "Give one without, such as a presigned URL."
        )
    port = parsed.port if parsed.port is not None else DEFAULT_PORTS[parsed.scheme]
    if port not in policy.ports:
        raise address_refused(
            f"The address asks for port {port}.", f"Use one of the ports {', '.join(map(str, sorted(policy.ports)))}."
        )
    return Target(parsed.scheme, host, _literal(host), port, path, authority)


def _literal(host: str) -> Address | None:
    """IP address that a host is, or None where it is a name."""
    try:
        return ip_address(host)
    except ValueError:
        if not NAME.fullmatch(host) or len(host) > LONGEST_NAME or NUMBER_AT_END.search(host):
            raise address_refused(
                "The host in the address is neither a name nor an IP address in its usual form."
            ) from None
        return None
