import pytest

from service.address_limit import MOST, AddressLimit, client_of


def test_an_address_may_ask_so_often_at_once_and_then_evenly() -> None:
    limit = AddressLimit(per_minute=3)
    assert [limit.spend("a", 100.0) for _ in range(4)] == [0, 0, 0, 20]
    assert limit.spend("b", 100.0) == 0, "another one has its own"
    assert limit.spend("a", 119.0) == 1
    assert limit.spend("a", 120.0) == 0
    assert limit.spend("a", 120.0) == 20
    assert [limit.spend("a", 1000.0) for _ in range(4)] == [0, 0, 0, 20], "no more is saved up"


def test_of_many_addresses_those_that_asked_last_are_remembered() -> None:
    limit = AddressLimit(per_minute=1)
    for number in range(MOST + 1):
        assert limit.spend(str(number), 0.0) == 0
    assert limit.spend(str(MOST), 0.0) == 60
    assert limit.spend("0", 0.0) == 0


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("192.0.2.1", "192.0.2.2", False),
        ("192.0.2.1", "::ffff:192.0.2.1", True),
        ("2001:db8::1", "2001:db8::ffff:2", True),
        ("2001:db8:0:1::1", "2001:db8:0:2::1", False),
        ("fe80::1%eth0", "fe80::2%eth0", True),
        ("", "192.0.2.1", False),
    ],
)
def test_who_counts_as_one_client(one: str, other: str, same: bool) -> None:
    assert (client_of(one) == client_of(other)) is same
