from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest

from core.errors import MeshmarkError
from service.jobs.clock import now
from service.jobs.events import ENDINGS
from service.jobs.ledger import Ledger, Submission
from service.outbound.policy import Policy
from service.webhooks import endpoints
from service.webhooks.endpoints import (
    OVERLAP,
    change_endpoint,
    check_job_webhook,
    create_endpoint,
    delete_endpoint,
    find_endpoint,
    list_endpoints,
    rotate_secret,
    secrets_of,
)
from service.webhooks.signing import new_secret

URL = "https://shop.example/hook"
TENANT = "default"


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def test_a_secret_is_made_or_taken(ledger: Ledger) -> None:
    made = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None)
    assert secrets_of(made, now()) == [made.secret]
    mine = new_secret()
    assert create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, mine).secret == mine
    with pytest.raises(MeshmarkError, match="invalid_secret"):
        create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, "whsec_short")
    assert len(list_endpoints(ledger.sessions, TENANT)) == 2


def test_after_a_rotation_both_secrets_sign_until_the_overlap_is_over(ledger: Ledger) -> None:
    first = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None)
    second = rotate_secret(ledger.sessions, TENANT, first.id, None)
    assert secrets_of(second, now()) == [second.secret, first.secret]
    assert secrets_of(second, now() + OVERLAP + timedelta(seconds=1)) == [second.secret]
    third = rotate_secret(ledger.sessions, TENANT, first.id, new_secret())
    assert secrets_of(third, now()) == [third.secret, second.secret]
    assert len({first.secret, second.secret, third.secret}) == 3


def test_a_jobs_webhook_needs_the_endpoint_that_signs_it(ledger: Ledger) -> None:
    with pytest.raises(MeshmarkError, match="no_webhook_secret"):
        check_job_webhook(ledger.sessions, TENANT, URL, Policy())
    create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None)
    with pytest.raises(MeshmarkError, match="no_webhook_secret"):
        check_job_webhook(ledger.sessions, TENANT, URL, Policy())
    signing = create_endpoint(ledger.sessions, TENANT, None, ENDINGS, None)
    check_job_webhook(ledger.sessions, TENANT, URL, Policy())
    with pytest.raises(MeshmarkError, match="address_refused"):
        check_job_webhook(ledger.sessions, TENANT, "https://10.0.0.1/", Policy())
    change_endpoint(ledger.sessions, TENANT, signing.id, None, None, disabled=True)
    with pytest.raises(MeshmarkError, match="no_webhook_secret"):
        check_job_webhook(ledger.sessions, TENANT, URL, Policy())


def test_of_many_requests_for_the_last_place_one_gets_it(ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "MOST", 3)

    def attempt(url: str | None) -> str:
        try:
            return create_endpoint(ledger.sessions, TENANT, url, ENDINGS, None).id
        except MeshmarkError as error:
            return error.code

    with ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(attempt, [None] * 4), key=len)[:3] == ["endpoint_exists"] * 3
        assert sorted(pool.map(attempt, [URL] * 4), key=len)[:2] == ["too_many_endpoints"] * 2
    assert len(list_endpoints(ledger.sessions, TENANT)) == 3
    assert list_endpoints(ledger.sessions, "acme") == []


def test_an_endpoint_without_a_url_gets_none(ledger: Ledger) -> None:
    endpoint = create_endpoint(ledger.sessions, TENANT, None, ENDINGS, None)
    with pytest.raises(MeshmarkError, match="invalid_request"):
        change_endpoint(ledger.sessions, TENANT, endpoint.id, URL, None, None)


def test_what_is_not_named_stays_as_it_is(ledger: Ledger) -> None:
    before = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None)
    after = change_endpoint(ledger.sessions, TENANT, before.id, None, ["watermark.failed"], None)
    assert (after.url, after.events, after.disabled_reason) == (URL, ["watermark.failed"], None)
    after = change_endpoint(ledger.sessions, TENANT, before.id, URL + "2", None, disabled=True)
    assert (after.url, after.events, after.disabled_reason) == (URL + "2", ["watermark.failed"], "requested")
    found = find_endpoint(ledger.sessions, TENANT, before.id)
    assert (found.url, found.secret) == (URL + "2", before.secret)


@pytest.mark.parametrize("stranger", [("acme", ""), (TENANT, "0")])
def test_another_tenants_endpoint_is_not_there(ledger: Ledger, stranger: tuple[str, str]) -> None:
    tenant, suffix = stranger
    identifier = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None).id + suffix
    for call in (
        lambda: find_endpoint(ledger.sessions, tenant, identifier),
        lambda: change_endpoint(ledger.sessions, tenant, identifier, URL, None, True),
        lambda: rotate_secret(ledger.sessions, tenant, identifier, None),
        lambda: delete_endpoint(ledger.sessions, tenant, identifier),
        lambda: find_endpoint(ledger.sessions, tenant, "\x00"),
    ):
        with pytest.raises(MeshmarkError, match="not_found"):
            call()


def test_an_endpoint_deleted_while_a_job_ends_fails_neither(ledger: Ledger) -> None:
    """Any order of the two is fine; what must not be is an error of the job's transaction."""
    jobs = [ledger.create("asset.glb", {}, {}, lambda _: True, Submission()).id for _ in range(20)]
    made = [create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None).id for _ in range(20)]
    with ThreadPoolExecutor(4) as pool:
        ended = [pool.submit(ledger.cancel, job_id) for job_id in jobs]
        deleted = [pool.submit(delete_endpoint, ledger.sessions, TENANT, identifier) for identifier in made]
        assert all(future.result() for future in ended)
        for future in deleted:
            future.result()
    assert list_endpoints(ledger.sessions, TENANT) == []
