import os
import subprocess
import sys
from ipaddress import ip_network
from pathlib import Path

import pytest
from pydantic import ValidationError

from core.budgets import DEFAULT_BUDGETS
from service.config import Settings, load_settings
from service.outbound.policy import Policy
from tests.service.conftest import client_with
from tests.worker.waiting import PATIENCE


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


def test_requests_to_users_addresses_reach_the_public_network_and_what_is_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert Settings().outbound == Policy()
    monkeypatch.setenv("MESHMARK_OUTBOUND_NETWORKS", "10.1.0.0/16, fc00::/7")
    monkeypatch.setenv("MESHMARK_OUTBOUND_PORTS", "443,8443")
    monkeypatch.setenv("MESHMARK_OUTBOUND_HTTP", "true")
    networks = (ip_network("10.1.0.0/16"), ip_network("fc00::/7"))
    assert Settings().outbound == Policy(networks, frozenset({"https", "http"}), frozenset({443, 8443}))


def test_every_setting_is_described() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("database_url", "mysql://localhost/jobs"),
        ("database_url", "postgresql+asyncpg://localhost/jobs"),
        ("database_url", "postgresql://localhost:port/jobs"),
        ("data_dir", "/dev/null/data"),
        ("store_url", "https://bucket.example"),
        ("s3_endpoint", "minio:9000"),
        ("broker_url", "amqp://localhost"),
        ("max_attempts", "0"),
        ("job_time_limit", "-1"),
        ("outbound_networks", "10.0.0.1/8"),
        ("outbound_networks", "internal"),
        ("outbound_ports", "http"),
        ("device", "gpu"),
        ("log_level", "loud"),
    ],
)
def test_a_setting_that_cannot_work_is_refused_at_start(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(f"MESHMARK_{name.upper()}", value)
    with pytest.raises(ValidationError, match=name):
        Settings()


NUMBERS = {name for name, field in Settings.model_fields.items() if field.annotation in (int, float)}


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_every_number_has_a_bound_that_arithmetic_can_take(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    for value in ("1" + "0" * 300, "1e300", "inf", "nan", "-1"):
        monkeypatch.setenv(f"MESHMARK_{name.upper()}", value)
        with pytest.raises(ValidationError, match=name):
            Settings()


@pytest.mark.parametrize("ports", ["0", "80,99999", "-1", ","])
def test_ports_of_others_are_ports(monkeypatch: pytest.MonkeyPatch, ports: str) -> None:
    monkeypatch.setenv("MESHMARK_OUTBOUND_PORTS", ports)
    with pytest.raises(ValidationError, match="outbound_ports"):
        Settings()


def test_the_largest_times_can_be_reckoned_with(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    for name in NUMBERS:
        bound = next(item.le for item in Settings.model_fields[name].metadata if hasattr(item, "le"))
        setattr(settings, name, bound)
    with client_with(settings) as client:
        url = client.submit()
        client.run(url)
        job = client.http.get(url).json()
        assert (job["state"], job["expires_at"][:3]) == ("succeeded", "212")


def test_a_setting_may_stand_in_a_file_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meshmark_database_url").write_text("postgresql://user:pass@db/jobs\n")
    (tmp_path / "meshmark_port").write_text("9000")
    monkeypatch.setenv("MESHMARK_PORT", "9001")
    settings = load_settings(tmp_path)
    assert settings.database_url == "postgresql://user:pass@db/jobs"
    assert settings.port == 9001
    assert load_settings(tmp_path / "nothing").port == 9001


def test_an_empty_variable_is_as_good_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_PORT", "")
    assert Settings().port == 8080


def start(command: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    environment = os.environ | {f"MESHMARK_{name.upper()}": value for name, value in variables.items()}
    return subprocess.run(
        [sys.executable, "-m", *command.split()], env=environment, capture_output=True, text=True, timeout=PATIENCE
    )


@pytest.mark.parametrize("command", ["service", "service api", "service --show-settings", "worker"])
def test_what_cannot_work_is_told_in_a_line_each_and_nothing_is_started(command: str) -> None:
    secret = "postgresql://user:secret@localhost:port/jobs"
    ended = start(command, port="99999", database_url=secret)
    assert ended.returncode == 2
    assert "secret" not in ended.stderr
    lines = ended.stderr.splitlines()
    assert [line.split(":")[0] for line in lines] == ["MESHMARK_PORT", "MESHMARK_DATABASE_URL"]
    assert "less than or equal to 65535" in lines[0]


def test_a_number_out_of_bounds_is_told_in_one_sentence_and_nothing_is_started() -> None:
    ended = start("service api", retention_seconds="1e300")
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith("MESHMARK_RETENTION_SECONDS: Input should be less than or equal to ")


def test_settings_that_do_not_go_together_are_refused() -> None:
    ended = start("service", s3_access_key_id="id")
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "MESHMARK_S3_SECRET_ACCESS_KEY" in ended.stderr
    assert "MESHMARK_STORE_URL" in start("service", s3_presign="true").stderr


@pytest.mark.parametrize("command", ["service", "service api"])
@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.2", "meshmark.example"])
def test_an_address_that_others_reach_is_refused_without_keys(command: str, host: str) -> None:
    ended = start(command, host=host)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert f"MESHMARK_HOST={host}" in ended.stderr
    assert "MESHMARK_AUTH=keys" in ended.stderr


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_needs_no_keys(host: str) -> None:
    assert Settings(host=host).auth == "none"
    assert Settings(host="0.0.0.0", auth="keys").host == "0.0.0.0"
