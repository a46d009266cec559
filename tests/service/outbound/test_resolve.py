import threading
from ipaddress import ip_network

import pytest

from core.errors import MeshmarkError
from service.outbound.errors import Unreachable
from service.outbound.policy import Policy
from service.outbound.resolve import Resolver, check_address, resolve, system_resolver
from service.outbound.target import parse_target
from tests.service.outbound.servers import LOOPBACK, at
from tests.worker.waiting import PATIENCE


def addresses(url: str, resolver: Resolver, policy: Policy | None = None, seconds: float = 5.0) -> list[str]:
    policy = policy or Policy()
    return [str(address) for address in resolve(parse_target(url, policy), policy, resolver, seconds)]


def test_a_name_stands_for_all_its_addresses_in_their_order() -> None:
    found = addresses("https://files.example/", at("2606:4700::1111", "1.1.1.1", "1.1.1.1"))
    assert found == ["2606:4700::1111", "1.1.1.1"]


@pytest.mark.parametrize("private", ["127.0.0.1", "10.1.2.3", "169.254.169.254", "::1", "fd00::1", "::ffff:10.1.2.3"])
def test_one_private_address_among_public_ones_is_enough_for_a_name_to_be_as_one_that_does_not_exist(
    private: str,
) -> None:
    told = set()
    for found in (("1.1.1.1", private), (private,), ()):
        with pytest.raises(Unreachable) as caught:
            addresses("https://files.example/", at(*found))
        told.add(str(caught.value))
    assert told == {"its name has no public address"}


def test_the_names_of_this_machine_have_none_as_the_system_resolves_them() -> None:
    with pytest.raises(Unreachable, match="no public address"):
        addresses("https://localhost/", system_resolver)
    allowing = Policy(allow=(LOOPBACK, ip_network("::1/128")))
    assert set(addresses("https://localhost/", system_resolver, allowing)) <= {"127.0.0.1", "::1"}


def test_an_address_is_checked_without_asking_anyone() -> None:
    def asked(host: str) -> list[str]:
        raise AssertionError(host)

    assert addresses("https://1.1.1.1/", asked) == ["1.1.1.1"]
    assert addresses("https://127.0.0.1/", asked, Policy(allow=(LOOPBACK,))) == ["127.0.0.1"]
    for literal in ("127.0.0.1", "[::1]", "[::ffff:127.0.0.1]", "[64:ff9b::7f00:1]", "169.254.169.254"):
        with pytest.raises(MeshmarkError, match="address_refused"):
            addresses(f"https://{literal}/", asked)


def test_a_name_without_an_address_is_said_to_have_none() -> None:
    with pytest.raises(Unreachable, match="no public address"):
        addresses("https://files.invalid/", system_resolver, seconds=30)


def test_a_name_server_that_does_not_answer_is_not_waited_for() -> None:
    over = threading.Event()

    def slow(_host: str) -> list[str]:
        over.wait(PATIENCE)
        return ["1.1.1.1"]

    with pytest.raises(Unreachable, match="not resolved"):
        addresses("https://files.example/", slow, seconds=0.2)
    assert not over.is_set()
    over.set()


@pytest.mark.parametrize(
    "url",
    [
        "https://127.0.0.1/hook",
        "https://169.254.169.254/latest/meta-data",
        "https://[::1]/",
        "https://[::ffff:10.0.0.1]/",
        "http://shop.example/hook",
        "https://shop.example:8080/",
        "https://user:password@shop.example/",
        "https://2130706433/",
        "ftp://shop.example/",
        "shop",
        "",
        "https://shop.example/" + "a" * 2048,
        "https://\ud800.example/",
    ],
)
def test_a_url_that_will_never_be_called_is_refused_at_once(url: str) -> None:
    with pytest.raises(MeshmarkError, match="address_refused"):
        check_address(url, Policy())


def test_what_the_operator_allows_is_accepted() -> None:
    check_address("https://shop.example/hook", Policy())
    allowed = Policy((ip_network("127.0.0.0/8"),), frozenset({"http"}), frozenset({8080}))
    check_address("http://127.0.0.1:8080/hook", allowed)
