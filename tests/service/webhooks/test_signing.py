import base64
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.webhooks.signing import new_secret, parse_secret, sign


def written(key: bytes) -> str:
    return "whsec_" + base64.b64encode(key).decode()


def test_a_signature_is_the_one_published_as_an_example() -> None:
    """The known answer that the reference libraries test with."""
    headers = sign(
        ["whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"],
        "msg_p5jXN8AQM9LWM0D4loKWxJek",
        datetime.fromtimestamp(1614265330, UTC),
        b'{"test": 2432232314}',
    )
    assert headers == {
        "webhook-id": "msg_p5jXN8AQM9LWM0D4loKWxJek",
        "webhook-timestamp": "1614265330",
        "webhook-signature": "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=",
    }


@given(st.lists(st.binary(min_size=24, max_size=64), min_size=1, max_size=4), st.text())
def test_receivers_verify_with_any_of_the_secrets(keys: list[bytes], text: str) -> None:
    body = f'"{text.encode(errors="replace").decode()}"'.encode()
    headers = sign([written(key) for key in keys], "msg_1", datetime.now(UTC), body)
    for key in keys:
        Webhook(written(key)).verify(body, headers, json_parse=False)


def test_receivers_refuse_another_secret_another_body_and_another_id() -> None:
    secret, body = new_secret(), b'{"a":1}'
    headers = sign([secret], "msg_1", datetime.now(UTC), body)
    assert Webhook(secret).verify(body, headers) == {"a": 1}
    for receiver, received, fields in (
        (Webhook(new_secret()), body, headers),
        (Webhook(secret), b'{"a":2}', headers),
        (Webhook(secret), body, headers | {"webhook-id": "msg_2"}),
        (Webhook(secret), body, headers | {"webhook-timestamp": str(int(headers["webhook-timestamp"]) + 1)}),
    ):
        with pytest.raises(WebhookVerificationError):
            receiver.verify(received, fields)


def test_a_secret_that_was_rotated_out_no_longer_signs() -> None:
    old, new = new_secret(), new_secret()
    during = sign([new, old], "msg_1", datetime.now(UTC), b"{}")
    after = sign([new], "msg_1", datetime.now(UTC), b"{}")
    assert len(during["webhook-signature"].split(" ")) == 2
    Webhook(old).verify(b"{}", during)
    with pytest.raises(WebhookVerificationError):
        Webhook(old).verify(b"{}", after)


def test_new_secrets_are_long_and_never_the_same() -> None:
    secrets = {new_secret() for _ in range(100)}
    assert len(secrets) == 100
    assert {len(parse_secret(secret)) for secret in secrets} == {32}


@pytest.mark.parametrize("size", [24, 64])
def test_secrets_of_the_sizes_in_the_specification_are_accepted(size: int) -> None:
    assert parse_secret(written(bytes(size))) == bytes(size)


@pytest.mark.parametrize(
    "secret",
    [
        *("", "whsec_", "secret", written(bytes(23)), written(bytes(65)), written(bytes(32)).removeprefix("whsec_")),
        *(written(bytes(32)) + "!", "whsec_" + "ä" * 40, written(bytes(32)).rstrip("=")),
    ],
)
def test_another_secret_is_refused_and_not_repeated(secret: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_secret(secret)
    assert caught.value.code == ServiceErrorCode.INVALID_SECRET
    assert len(secret) < 10 or secret not in str(caught.value)


def test_nothing_is_sent_unsigned_or_with_an_ambiguous_id() -> None:
    now = datetime.now(UTC)
    with pytest.raises(ValueError, match="at least one secret"):
        sign([], "msg_1", now, b"{}")
    with pytest.raises(ValueError, match="no dot"):
        sign([new_secret()], "msg.1", now, b"{}")
