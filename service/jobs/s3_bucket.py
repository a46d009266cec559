"""Connections to S3 buckets: that of the artifact store, and those of upload hooks."""

from typing import Any

from obstore.store import S3Store
from pydantic import SecretStr


def open_bucket(
    name: str,
    prefix: str | None,
    endpoint: str,
    region: str,
    access_key_id: SecretStr,
    secret_access_key: SecretStr,
    timeouts: tuple[str, str],
    retries: Any,
) -> S3Store:
    """A bucket; `timeouts` are those of a connection and of a request.

    Empty arguments default as in every tool for S3: `AWS_...` in the environment, or the machine's role. Keys that are
    given are used alone: a session token in the environment belongs to other keys, and must not reach this server.
    """
    place = {key: value for key, value in {"endpoint": endpoint, "region": region}.items() if value}
    keys: Any = {
        "access_key_id": access_key_id.get_secret_value(),
        "secret_access_key": secret_access_key.get_secret_value(),
        "token": None,
        "expires_at": None,
    }
    return S3Store(
        name,
        prefix=prefix,
        config=place,  # type: ignore[arg-type]
        client_options={
            "allow_http": endpoint.startswith("http://"),
            "connect_timeout": timeouts[0],
            "timeout": timeouts[1],
        },
        retry_config=retries,
        credential_provider=(lambda: keys) if keys["access_key_id"] else None,
    )


def error_line(error: BaseException) -> str:
    """Message of a bucket library's error, in one line, without the debug output that follows it."""
    return " ".join(str(error).partition("\n\nDebug source:")[0].split())[:500]
