"""Webhooks as the service signs them, and as others might."""

from datetime import UTC, datetime, timedelta

import pytest

from service.client import InvalidWebhookError, verify_webhook
from service.webhooks.signing import new_secret, sign

SECRET, BODY = new_secret(), b'{"type": "watermark.succeeded", "timestamp": "now", "data": {"id": "1"}}'


def signed(*secrets: str, sent_at: datetime | None = None) -> dict[str, str]:
    return sign(secrets or (SECRET,), "msg_1", sent_at or datetime.now(UTC), BODY)


@pytest.mark.parametrize("change", [str, str.title, str.upper])
def test_a_message_of_the_service_is_read_however_its_headers_are_written(change: type[str]) -> None:
    headers = {change(name): value for name, value in signed().items()}
    assert verify_webhook(headers, BODY, SECRET)["data"] == {"id": "1"}


def test_secrets_can_be_changed() -> None:
    former = new_secret()
    assert verify_webhook(signed(SECRET, former), BODY, former), "the service signs with both"
    assert verify_webhook(signed(former), BODY, [SECRET, former]), "the receiver knows both"


@pytest.mark.parametrize("body", [BODY + b" ", BODY.replace(b"1", b"2"), b""])
def test_a_message_that_was_changed_is_refused(body: bytes) -> None:
    with pytest.raises(InvalidWebhookError, match="No signature"):
        verify_webhook(signed(), body, SECRET)


def test_a_signature_by_another_secret_is_refused() -> None:
    with pytest.raises(InvalidWebhookError, match="No signature"):
        verify_webhook(signed(new_secret()), BODY, SECRET)


@pytest.mark.parametrize("hours", [-1, 1])
def test_an_old_message_is_refused_and_one_of_the_future_too(hours: int) -> None:
    with pytest.raises(InvalidWebhookError, match="last minutes"):
        verify_webhook(signed(sent_at=datetime.now(UTC) + timedelta(hours=hours)), BODY, SECRET)


@pytest.mark.parametrize("name", ["webhook-id", "webhook-timestamp", "webhook-signature"])
def test_a_message_without_its_headers_is_refused(name: str) -> None:
    headers = {key: value for key, value in signed().items() if key != name}
    with pytest.raises(InvalidWebhookError, match=name):
        verify_webhook(headers, BODY, SECRET)


def test_signatures_of_other_schemes_beside_it_do_no_harm() -> None:
    headers = signed()
    headers["webhook-signature"] = f"v1a,ä {headers['webhook-signature']} v2,x"
    assert verify_webhook(headers, BODY, SECRET)


@pytest.mark.parametrize("secret", ["", "whsec_", "whsec_not base64", "whsec_c2hvcnQ="])
def test_a_secret_that_is_none_is_no_secret(secret: str) -> None:
    with pytest.raises(ValueError, match="secret"):
        verify_webhook(signed(), BODY, secret)
