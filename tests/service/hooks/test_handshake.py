"""A sender of CloudEvents asks whether it may send, as Azure Event Grid does."""

from pathlib import Path

import pytest

from service.config import Settings
from tests.service.conftest import client_with

HOOKS = """
[sources.{name}]
kind = "cloudevents"
token = "0123456789abcdef"
bucket = "assets"
input_prefix = "{name}/"
output_prefix = "watermarked/"
parameters = {{ text = "HI" }}
{more}
"""
ASKING = {
    "WebHook-Request-Origin": "eventgrid.azure.net",
    "WebHook-Request-Callback": "https://rp-westeurope.eventgrid.azure.net/eventsubscriptions/a/validate?id=1",
    "WebHook-Request-Rate": "120",
}


@pytest.fixture
def hooks_file(tmp_path: Path) -> Path:
    path = tmp_path / "hooks.toml"
    open_one = HOOKS.format(name="open", more='origins = ["EventGrid.azure.net", "events.example"]')
    path.write_text(open_one + HOOKS.format(name="closed", more=""))
    return path


def test_a_configured_sender_may_send_and_needs_no_token_to_ask(hooks_file: Path, tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, hooks_file=hooks_file, auth="keys")) as client:
        for origin in ("eventgrid.azure.net", "EVENTS.example"):
            answer = client.http.options("/v1/hooks/open", headers={**ASKING, "WebHook-Request-Origin": origin})
            assert (answer.status_code, answer.content) == (200, b"")
            assert answer.headers["WebHook-Allowed-Origin"] == origin
            assert answer.headers["WebHook-Allowed-Rate"] == "*"
            assert answer.headers["Allow"] == "POST"
        event = client.http.post("/v1/hooks/open", json={}, headers=ASKING)
        assert event.status_code == 401, "to ask is not to be let in"


@pytest.mark.parametrize(
    ("source", "origin", "status"),
    [
        ("closed", "eventgrid.azure.net", 405),
        ("open", "eventgrid.azure.net.evil.example", 405),
        ("open", "*", 405),
        ("open", "", 405),
        ("open", None, 405),
        ("nobody", "eventgrid.azure.net", 404),
    ],
)
def test_nobody_else_is_told_that_they_may_send(
    source: str, origin: str | None, status: int, hooks_file: Path, tmp_path: Path
) -> None:
    with client_with(Settings(data_dir=tmp_path, hooks_file=hooks_file)) as client:
        headers = {} if origin is None else {"WebHook-Request-Origin": origin}
        answer = client.http.options(f"/v1/hooks/{source}", headers=headers)
        assert answer.status_code == status
        assert answer.json()["status"] == status
        assert not [name for name in answer.headers if name.lower().startswith("webhook-")]
        assert status == 404 or answer.headers["Allow"] == "POST"
