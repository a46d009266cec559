from pathlib import Path

import pytest
from pydantic import ValidationError

from core.asset.budgets import DEFAULT_BUDGETS
from service.config import Settings


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_MAX_UPLOAD_BYTES", "1000")
    assert Settings().max_upload_bytes == 1000


def test_by_default_nothing_outside_the_data_folder_is_needed(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    assert settings.ledger_url == f"sqlite:///{tmp_path}/ledger.sqlite3"
    assert settings.broker_url == "filesystem://"


def test_budgets_are_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Settings().budgets == DEFAULT_BUDGETS
    for name in ("max_upload_bytes", "max_unpacked_bytes", "max_faces", "max_vertices", "max_image_pixels"):
        monkeypatch.setenv(f"MESHMARK_{name.upper()}", "77")
    budgets = Settings().budgets
    assert [budgets.bytes, budgets.unpacked_bytes, budgets.faces, budgets.vertices, budgets.image_pixels] == [77] * 5


def test_every_setting_is_described() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("database_url", "mysql://localhost/jobs"),
        ("broker_url", "amqp://localhost"),
        ("max_attempts", "0"),
        ("job_time_limit", "-1"),
        ("device", "gpu"),
        ("log_level", "loud"),
    ],
)
def test_a_setting_that_cannot_work_is_refused_at_start(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(f"MESHMARK_{name.upper()}", value)
    with pytest.raises(ValidationError, match=name):
        Settings()
