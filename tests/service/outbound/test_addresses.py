"""Public addresses, judged against Python's ipaddress where that knows better than a list of examples."""

from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from service.outbound.addresses import refusal

# Public by ipaddress (of one Python release or another), and still no place to send a request to.
OURS_ALONE = [ip_network(net) for net in ("192.88.99.0/24", "168.63.129.16/32", "192.0.0.0/24")]

WITH_IPV4_INSIDE = ip_network("::/8")  # mapped and NAT64 addresses, on which Python's releases do not agree


def mapped(address: IPv4Address) -> IPv6Address:
    return IPv6Address(f"::ffff:{address}")


def translated(address: IPv4Address) -> IPv6Address:
    return IPv6Address(f"64:ff9b::{address}")


def compatible(address: IPv4Address) -> IPv6Address:
    return IPv6Address(int(address))


def sixtofour(address: IPv4Address) -> IPv6Address:
    return IPv6Address(0x2002 << 112 | int(address) << 80 | 1)


def teredo(address: IPv4Address) -> IPv6Address:
    return IPv6Address(0x20010000 << 96 | 0x01020304 << 64 | (int(address) ^ 0xFFFFFFFF))


def local_translated(address: IPv4Address) -> IPv6Address:
    return IPv6Address(0x0064FF9B0001 << 80 | int(address))


@pytest.mark.parametrize(
    "address",
    [
        *("0.0.0.0", "0.1.2.3", "10.0.0.1", "100.64.0.1", "100.100.100.200", "100.127.255.255", "127.0.0.1"),
        *("127.255.255.254", "169.254.169.254", "172.16.0.1", "172.31.255.255", "192.0.0.192", "192.168.1.1"),
        *("168.63.129.16", "198.18.0.1", "198.19.255.255", "203.0.113.7", "224.0.0.1", "239.255.255.250"),
        *("240.0.0.1", "255.255.255.255"),
        *("::", "::1", "::2", "fc00::1", "fd00:ec2::254", "fe80::1", "fe80::1%eth0", "fec0::1", "ff02::1", "100::1"),
        *("2001:db8::1", "2001:2::1", "2001::1", "2002:7f00:1::", "3fff::1", "4000::1", "5f00::1", "2606:4700::1%1"),
    ],
)
def test_an_address_that_is_not_public_is_refused(address: str) -> None:
    assert refusal(ip_address(address))


@pytest.mark.parametrize(
    "address",
    [
        *("1.1.1.1", "8.8.8.8", "100.63.255.255", "100.128.0.0", "172.32.0.1", "192.0.1.1", "223.255.255.255"),
        *("2606:4700::1111", "2a00:1450:4001::1", "2001:4860:4860::8888", "::ffff:8.8.8.8", "64:ff9b::808:808"),
    ],
)
def test_a_public_address_is_not(address: str) -> None:
    assert refusal(ip_address(address)) is None


@given(st.ip_addresses(v=4))
def test_an_ipv4_address_is_public_if_python_says_so(address: IPv4Address) -> None:
    public = address.is_global and not (address.is_multicast or address.is_reserved)
    assert (refusal(address) is None) <= public
    if public and not any(address in network for network in OURS_ALONE):
        assert refusal(address) is None


@given(st.ip_addresses(v=6))
def test_an_ipv6_address_is_public_only_if_python_says_so(address: IPv6Address) -> None:
    if refusal(address) is None and address not in WITH_IPV4_INSIDE:
        assert address.is_global
        assert not address.is_multicast
        assert not address.is_reserved
        assert not address.is_site_local
        assert not address.sixtofour
        assert not address.teredo


@given(st.ip_addresses(v=4))
@example(IPv4Address("127.0.0.1"))
@example(IPv4Address("8.8.8.8"))
def test_an_ipv4_address_within_an_ipv6_one_is_not_a_way_around(address: IPv4Address) -> None:
    assert refusal(mapped(address)) == refusal(address)
    assert refusal(translated(address)) == refusal(address)
    assert refusal(compatible(address))
    assert refusal(sixtofour(address))
    assert refusal(teredo(address))
    assert refusal(local_translated(address))


@given(st.ip_addresses(), st.integers(0, 32))
def test_an_allowed_network_is_reached_and_nothing_beside_it(address: IPv4Address | IPv6Address, length: int) -> None:
    private = ip_network(f"10.0.0.0/{max(length, 8)}")
    if address in private:
        assert refusal(address, [private]) is None
    else:
        assert refusal(address, [private]) == refusal(address)


def test_an_allowed_network_is_reached_by_its_mapped_addresses_too() -> None:
    assert refusal(ip_address("::ffff:10.1.2.3"), [ip_network("10.0.0.0/8")]) is None
    assert refusal(ip_address("::ffff:10.1.2.3"), [ip_network("11.0.0.0/8")]) == "private"
