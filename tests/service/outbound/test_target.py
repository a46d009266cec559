import socket
from ipaddress import IPv4Address, ip_address

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.outbound.policy import Policy
from service.outbound.target import Target, parse_target

ANY_PORT = Policy(schemes=frozenset({"http", "https"}), ports=frozenset(range(65536)))


def refused(url: str, policy: Policy | None = None) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        parse_target(url, policy or Policy())
    assert caught.value.code == ServiceErrorCode.ADDRESS_REFUSED
    return caught.value


def odd_forms(address: IPv4Address) -> list[str]:
    """The ways to write an IPv4 address that only old programs understand."""
    a, b, c, d = address.packed
    return [
        str(int(address)),
        hex(int(address)),
        f"0{int(address):o}",
        f"{a}.{int(address) & 0xFFFFFF}",
        f"{a}.{b}.{int(address) & 0xFFFF}",
        f"{a:#x}.{b:#x}.{c:#x}.{d:#x}",
        f"0{a:o}.0{b:o}.0{c:o}.0{d:o}",
        f"{a}.{b}.{c}.{d:#x}",
        f"{address}.",
    ]


def test_a_url_is_taken_apart() -> None:
    target = parse_target("https://Files.Example/a%20b/ü?x=1&y=%2F#part", Policy())
    assert target == Target("https", "files.example", None, 443, "/a%20b/%C3%BC?x=1&y=%2F", "files.example")


def test_a_name_in_another_script_is_asked_for_as_the_dns_writes_it() -> None:
    assert parse_target("https://例え.jp/", Policy()).host == "xn--r8jz45g.jp"


def test_an_address_is_taken_as_it_is() -> None:
    target = parse_target("http://[2606:4700::1111]:8080/", ANY_PORT)
    assert (target.address, target.authority) == (ip_address("2606:4700::1111"), "[2606:4700::1111]:8080")
    assert parse_target("https://1.1.1.1", Policy()).address == ip_address("1.1.1.1")


@pytest.mark.parametrize("scheme", ["http", "ftp", "file", "gopher", "data", "unix", ""])
def test_only_https_is_accepted_unless_allowed(scheme: str) -> None:
    assert "https://" in refused(f"{scheme}://files.example/").message


def test_http_is_accepted_where_it_is_allowed() -> None:
    policy = Policy(schemes=frozenset({"http", "https"}))
    assert parse_target("http://files.example/", policy).port == 80
    assert "http or https://" in refused("ftp://files.example/", policy).message


@pytest.mark.parametrize("port", [0, 22, 25, 6379, 8443, 65536, 99999])
def test_only_the_ports_of_the_web_are_accepted_unless_allowed(port: int) -> None:
    assert str(port) in refused(f"https://files.example:{port}/").message


@pytest.mark.parametrize("userinfo", ["user@", "user:secret@", ":secret@", ":@", "files.example%20@", "a\\@"])
def test_a_user_name_or_a_password_is_refused(userinfo: str) -> None:
    error = refused(f"https://{userinfo}files.example/")
    assert "password" in error.message
    assert "secret" not in str(error)


@pytest.mark.parametrize(
    "host",
    [
        *("", ".", "a..b", "-a.example", "a-.example", "a b", "a%00b", "ex%61mple.com", "a_b!", "files.example."),
        *("[fe80::1%25eth0]x", "[::1", "::1", "[127.0.0.1]", "[::ffff:127.0.0.1", "a" * 64 + ".example"),
        *(
            ".".join(["a" * 60] * 5),
            "256.256.256.256",
            "1.2.3.4.5",
            "\uff11\uff12\uff17.0.0.1",
            "0x",
            "files.0x7f",
            "files.1",
        ),
    ],
)
def test_a_host_that_is_neither_a_name_nor_an_address_is_refused(host: str) -> None:
    refused(f"https://{host}/")


@pytest.mark.parametrize("url", ["https://files.example/\r\nHost: other", "https://files.example\n/", "https://a/\x00"])
def test_a_url_does_not_carry_header_lines(url: str) -> None:
    refused(url)


def test_a_very_long_url_is_refused() -> None:
    refused("https://files.example/" + "a" * 3000)


@given(st.ip_addresses(v=4))
def test_an_address_in_another_than_its_usual_form_is_refused(address: IPv4Address) -> None:
    for form in odd_forms(address):
        refused(f"https://{form}/")
    assert parse_target(f"https://{address}/", Policy()).address == address


@given(st.text("0123456789abcdefx.", min_size=1, max_size=20))
def test_no_host_is_taken_for_a_name_that_the_system_reads_as_an_address(host: str) -> None:
    try:
        target = parse_target(f"https://{host}/", Policy())
    except MeshmarkError:
        return
    if target.address is None:
        with pytest.raises(OSError, match="illegal IP address"):
            socket.inet_aton(target.host)


@given(st.text() | st.text().map("https://{}".format))
def test_any_text_is_either_refused_or_a_target_that_is_only_printable_ascii(url: str) -> None:
    try:
        target = parse_target(url, Policy())
    except MeshmarkError:
        return
    sent = target.host + target.path + target.authority
    assert sent.isascii()
    assert sent.isprintable()
    assert " " not in sent
