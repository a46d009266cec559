import os
import subprocess
import sys
from pathlib import Path

from pydantic import SecretStr

from service.config import Settings
from service.show_settings import show_settings


def shown(settings: Settings, environment: dict[str, str], secrets: Path) -> dict[str, tuple[str, str]]:
    return {variable: (value, origin) for variable, value, origin in show_settings(settings, environment, secrets)}


def test_every_setting_is_listed_with_its_value_and_where_it_comes_from(tmp_path: Path) -> None:
    (tmp_path / "meshmark_max_faces").write_text("7")
    table = shown(Settings(port=9000, max_faces=7), {"meshmark_port": "9000", "MESHMARK_HOST": ""}, tmp_path)
    assert list(table) == [f"MESHMARK_{name.upper()}" for name in Settings.model_fields]
    assert table["MESHMARK_PORT"] == ("9000", "environment")
    assert table["MESHMARK_MAX_FACES"] == ("7", f"file in {tmp_path}")
    assert table["MESHMARK_HOST"] == ("127.0.0.1", "default")


def test_secrets_are_not_shown(tmp_path: Path) -> None:
    settings = Settings(
        database_url="postgresql+psycopg://jobs:hidden@db:5432/jobs?sslpassword=hidden&sslmode=require",
        broker_url="redis://:hidden@redis:6379/0",
        s3_access_key_id=SecretStr("hidden"),
        s3_secret_access_key=SecretStr("hidden"),
    )
    table = shown(settings, {}, tmp_path)
    assert "hidden" not in str(table)
    assert table["MESHMARK_DATABASE_URL"][0] == (
        "postgresql+psycopg://jobs:**********@db:5432/jobs?sslpassword=**********&sslmode=require"
    )
    assert table["MESHMARK_BROKER_URL"][0] == "redis://:**********@redis:6379/0"
    assert table["MESHMARK_S3_SECRET_ACCESS_KEY"][0] == "**********"


def test_a_misspelled_setting_is_pointed_out(tmp_path: Path) -> None:
    environment = {"MESHMARK_DATABSE_URL": "postgresql://jobs:hidden@db/jobs", "MESHMARK_MODELS": "/models"}
    table = shown(Settings(), environment, tmp_path)
    assert table["MESHMARK_DATABSE_URL"] == ("(not a setting: ignored)", "environment")
    assert "MESHMARK_MODELS" not in table


def test_the_command_prints_a_line_for_each() -> None:
    environment = os.environ | {"MESHMARK_LOG_LEVEL": "WARNING"}
    command = [sys.executable, "-m", "service", "--show-settings"]
    lines = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(lines) >= len(Settings.model_fields)
    assert ["MESHMARK_LOG_LEVEL", "WARNING", "environment"] in [line.split() for line in lines]
