from collections.abc import Iterator
from datetime import timedelta

import pytest
from sqlalchemy import update

from service.jobs.clock import now
from service.jobs.ledger import Ledger
from service.jobs.models import ApiKey
from service.jobs.tenants import KEY, Scope, Sessions, authenticate, create_key, list_keys, note_use, revoke_key


@pytest.fixture
def sessions(database_url: str) -> Iterator[Sessions]:
    ledger = Ledger(database_url)
    yield ledger.sessions
    ledger.close()


def test_a_new_key_is_that_of_its_tenant_with_what_it_may_do(sessions: Sessions) -> None:
    made = create_key(sessions, "acme", "uploads", [Scope.WRITE, Scope.READ])
    key = authenticate(sessions, made.text)
    assert key is not None
    assert (key.id, key.tenant_id, key.name, key.scopes) == (
        made.row.id,
        "acme",
        "uploads",
        ["jobs:read", "jobs:write"],
    )
    assert KEY.fullmatch(made.text)


def test_the_secret_is_not_kept(sessions: Sessions) -> None:
    made = create_key(sessions, "acme", "uploads", Scope)
    secret = made.text.split("_")[2]
    [row] = list_keys(sessions)
    assert secret not in str({column.name: getattr(row, column.name) for column in row.__table__.columns})


def test_what_is_not_quite_the_key_is_none(sessions: Sessions) -> None:
    text, other = (create_key(sessions, "acme", name, Scope).text for name in ("one", "two"))
    last = "a" if text[-1] != "a" else "b"
    mixed = "_".join([*text.split("_")[:2], other.split("_")[2]])
    for wrong in ("", "mm__", text[:-1], text + "a", text[:-1] + last, text.upper(), f" {text}", mixed, text + "\n"):
        assert authenticate(sessions, wrong) is None, wrong


def test_a_revoked_key_ends_at_once_and_the_others_stay(sessions: Sessions) -> None:
    first, second = (create_key(sessions, "acme", name, Scope) for name in ("one", "two"))
    assert revoke_key(sessions, first.row.id)
    assert authenticate(sessions, first.text) is None
    assert authenticate(sessions, second.text) is not None
    assert not revoke_key(sessions, first.row.id)
    assert not revoke_key(sessions, "nothing0")


def test_a_key_ends_when_its_time_is_over(sessions: Sessions) -> None:
    made = create_key(sessions, "acme", "short", Scope, now() + timedelta(hours=1))
    assert authenticate(sessions, made.text) is not None
    with sessions.begin() as session:
        session.execute(update(ApiKey).values(expires_at=now() - timedelta(seconds=1)))
    assert authenticate(sessions, made.text) is None


def test_the_last_use_of_a_key_is_known_to_the_minute(sessions: Sessions) -> None:
    text, began = create_key(sessions, "acme", "uploads", Scope).text, now()
    seen = []
    for _ in range(2):
        key = authenticate(sessions, text)
        assert key is not None
        note_use(sessions, key)
        seen.append(list_keys(sessions, "acme")[0].last_used_at)
    assert seen[0] == seen[1]
    assert seen[0] is not None
    assert began <= seen[0] <= now()


def test_keys_are_listed_by_tenant(sessions: Sessions) -> None:
    for tenant, name in (("acme", "one"), ("acme", "two"), ("beta", "three")):
        create_key(sessions, tenant, name, Scope)
    assert [key.name for key in list_keys(sessions, "acme")] == ["one", "two"]
    assert [key.name for key in list_keys(sessions)] == ["one", "two", "three"]


@pytest.mark.parametrize("name", ["", "Acme", "a b", "-a", "a" * 64, "ä", "a\n"])
def test_a_name_that_no_tenant_can_have_is_refused(sessions: Sessions, name: str) -> None:
    with pytest.raises(ValueError, match="is no tenant"):
        create_key(sessions, name, "key", Scope)
    assert list_keys(sessions) == []
