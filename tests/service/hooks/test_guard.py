import hashlib
import hmac

import pytest

from core.errors import MeshmarkError
from service.hooks.config import HookSource
from service.hooks.guard import check_signature, check_token

SECRET = "0123456789abcdef"
BODY = b'{"Records": []}'


def hook(**secrets: str) -> HookSource:
    return HookSource.model_validate(
        {
            "kind": "s3",
            "bucket": "assets",
            "input_prefix": "in/",
            "output_prefix": "out/",
            "parameters": {"text": "HI"},
            **secrets,
        }
    )


def signature(body: bytes = BODY, secret: str = SECRET) -> str:
    return hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()


@pytest.mark.parametrize("shown", [SECRET, f"Bearer {SECRET}", f"bearer  {SECRET}"])
def test_the_token_is_taken_with_and_without_its_scheme(shown: str) -> None:
    check_token(hook(token=SECRET), {"Authorization": shown})


def test_the_token_may_be_in_another_header() -> None:
    source = hook(token=SECRET, token_header="X-Token")
    check_token(source, {"X-Token": SECRET})
    with pytest.raises(MeshmarkError, match="invalid_hook_token"):
        check_token(source, {"Authorization": SECRET})


@pytest.mark.parametrize("shown", ["", "Bearer", SECRET[:-1], SECRET + "0", f"Basic {SECRET}", "\xe4" * 16, "é€"])
def test_another_token_is_refused(shown: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_hook_token") as caught:
        check_token(hook(token=SECRET), {"Authorization": shown})
    assert SECRET not in str(caught.value)


def test_a_signed_body_is_taken() -> None:
    source = hook(hmac_secret=SECRET)
    check_token(source, {})
    for shown in (signature(), f"sha256={signature()}", signature().upper()):
        check_signature(source, {"X-Hub-Signature-256": shown}, BODY)
    check_signature(hook(hmac_secret=SECRET, hmac_header="X-Sign"), {"X-Sign": signature()}, BODY)


@pytest.mark.parametrize("shown", ["", "sha256=", signature(b"other"), signature(secret="another secret of all")])
def test_a_body_that_was_not_signed_is_refused(shown: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_hook_token"):
        check_signature(hook(hmac_secret=SECRET), {"X-Hub-Signature-256": shown}, BODY)
