"""Public and special-purpose IP addresses.

An own table instead of `ipaddress.is_global`, whose answers differ between Python releases. Sources: the IANA
special-purpose address registries (RFC 6890), RFC 5771 and RFC 4291.
"""

from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network

Address = IPv4Address | IPv6Address
Network = IPv4Network | IPv6Network

NOT_PUBLIC_V4 = {
    IPv4Network(network): kind
    for network, kind in {
        "0.0.0.0/8": "unspecified",
        "10.0.0.0/8": "private",
        "100.64.0.0/10": "shared (carrier-grade NAT)",
        "127.0.0.0/8": "loopback",
        "168.63.129.16/32": "platform",  # Azure's host agent, on every machine there
        "169.254.0.0/16": "link-local",
        "172.16.0.0/12": "private",
        "192.0.0.0/24": "reserved",
        "192.0.2.0/24": "documentation",
        "192.88.99.0/24": "6to4 relay",
        "192.168.0.0/16": "private",
        "198.18.0.0/15": "benchmarking",
        "198.51.100.0/24": "documentation",
        "203.0.113.0/24": "documentation",
        "224.0.0.0/4": "multicast",
        "240.0.0.0/4": "reserved",
    }.items()
}
# Of IPv6 only global unicast is public, so all else needs no entry here: ::, ::1, fc00::/7, fe80::/10, ff00::/8, ...
GLOBAL_UNICAST = IPv6Network("2000::/3")
NOT_PUBLIC_V6 = {
    IPv6Network(network): kind
    for network, kind in {
        "2001::/23": "reserved",  # Teredo (2001::/32) among it
        "2001:db8::/32": "documentation",
        "2002::/16": "6to4",
        "3fff::/20": "documentation",
    }.items()
}
NAT64 = IPv6Network("64:ff9b::/96")  # the well-known prefix of RFC 6052


def bare(address: Address) -> Address:
    """IPv4 address that is reached through an IPv4-mapped (RFC 4291) or NAT64 (RFC 6052) one, or the same address."""
    if isinstance(address, IPv6Address):
        if address.ipv4_mapped:
            return address.ipv4_mapped
        if address in NAT64:
            return IPv4Address(int(address) & 0xFFFFFFFF)
    return address


def refusal(address: Address, allow: Iterable[Network] = ()) -> str | None:
    """Kind of an address that is neither public nor in an allowed network; None for all others."""
    reached = bare(address)
    if any(reached in network for network in allow):
        return None
    if isinstance(reached, IPv4Address):
        return next((kind for network, kind in NOT_PUBLIC_V4.items() if reached in network), None)
    if reached.scope_id or reached not in GLOBAL_UNICAST:
        return "local or reserved"
    return next((kind for network, kind in NOT_PUBLIC_V6.items() if reached in network), None)
