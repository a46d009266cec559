from datetime import timedelta

import obstore
import pytest
from pydantic import SecretStr

from service.jobs.s3_bucket import open_bucket

ENVIRONMENT = {"ACCESS_KEY_ID": "key-of-the-machine", "SECRET_ACCESS_KEY": "secret", "SESSION_TOKEN": "its-session"}


def link(access_key_id: str, secret_access_key: str) -> str:
    """A presigned address, which tells by what it was signed."""
    keys = (SecretStr(access_key_id), SecretStr(secret_access_key))
    bucket = open_bucket("bucket", None, "http://store.example", "us-east-1", *keys, ("1s", "1s"), None)
    return obstore.sign(bucket, "GET", "key", timedelta(minutes=1))


def test_own_keys_are_not_mixed_with_the_session_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in ENVIRONMENT.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    own = link("our-key", "our-secret")
    assert own.startswith("http://store.example/bucket/key?")
    assert "our-key" in own
    assert "its-session" not in own
    assert "X-Amz-Security-Token" not in own
    machines = link("", "")
    assert "key-of-the-machine" in machines
    assert "its-session" in machines
