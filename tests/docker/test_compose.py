"""The compose file: right by its specification, closed by default, and good for a job when its processes run."""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from service.config import PREFIX, Settings
from tests.service.harness import Service, free_port, running
from tests.service.postgres import Postgres
from tests.service.s3 import S3, s3_server
from tests.service.test_embedded import CUBE
from tests.worker.waiting import wait_until

ROOT = Path(__file__).parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
CREDENTIALS: dict[str, dict[str, Any]] = {
    "signer": yaml.safe_load((ROOT / "docker" / "compose.credentials.yaml").read_text())["services"]["signer"]
}
SERVERS = {"postgres", "redis", "store", "bucket"}


@pytest.fixture(scope="module")
def secrets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compose") / "secrets"
    subprocess.run(["sh", ROOT / "docker" / "make-secrets.sh", folder], check=True)
    return folder


def test_it_is_a_compose_file() -> None:
    schema = json.loads((ROOT / "tests" / "data" / "compose-spec.json").read_text())
    jsonschema.Draft7Validator(schema).validate(COMPOSE)
    broken = {**COMPOSE, "services": {"api": {"read_only": "perhaps", "imagine": 1}}}
    assert list(jsonschema.Draft7Validator(schema).iter_errors(broken)), "the schema refuses what is none"


def test_dockers_own_reading_agrees() -> None:
    docker = shutil.which("docker")
    if docker is None or subprocess.run([docker, "compose", "version"], capture_output=True, check=False).returncode:
        pytest.skip("there is no `docker compose` here")
    subprocess.run([docker, "compose", "-f", ROOT / "docker" / "compose.yaml", "config", "--quiet"], check=True)


@pytest.mark.parametrize("name", SERVICES)
def test_every_container_is_closed_and_bounded(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not {"privileged", "cap_add", "network_mode", "pid", "ipc", "devices"} & service.keys()
    assert service["pids_limit"] <= 512
    assert re.fullmatch(r"\d+[mg]", service["mem_limit"])
    assert "docker.sock" not in str(service)
    assert re.search(r":v?\d+\.\d+", service["image"]), "a version, and not whatever is newest"
    one_off = name == "bucket"
    assert ("healthcheck" in service) != (one_off or name == "api")  # the image has the API's


def test_servers_are_on_a_network_without_a_way_out_and_nothing_but_loopback_is_published() -> None:
    assert COMPOSE["networks"]["back"]["internal"] is True
    for name, service in SERVICES.items():
        if name in SERVERS | {"worker", "prometheus"}:
            assert service["networks"] == ["back"]
        for port in service.get("ports", []):
            assert port.startswith("127.0.0.1:")
    assert {name for name, service in SERVICES.items() if "ports" in service} == {"api", "grafana"}


def test_their_network_does_not_lead_to_this_machine_either() -> None:
    """Where the bridge has an address, containers reach whatever listens on it or on all of the machine's."""
    assert COMPOSE["networks"]["back"]["driver_opts"] == {
        "com.docker.network.bridge.inhibit_ipv4": "true",  # Docker before 28
        "com.docker.network.bridge.gateway_mode_ipv4": "isolated",
    }
    assert COMPOSE["networks"]["front"] is COMPOSE["networks"]["out"] is None
    assert "Docker 25.0.5 or newer" in (ROOT / "docker" / "compose.yaml").read_text()


def test_no_container_leaves_a_volume_without_a_name_behind() -> None:
    """Docker makes one where an image declares a volume and nothing is mounted there; nobody finds it again."""
    declared = {"redis": "/data", "postgres": "/var/lib/postgresql/data", "store": "/data", "bucket": "/data"}
    named = set(COMPOSE["volumes"])
    for name, service in SERVICES.items():
        targets = set()
        for volume in service.get("volumes", []):
            if isinstance(volume, dict):
                assert volume["type"] == "tmpfs"
                targets.add(volume["target"])
            else:
                source, target = volume.split(":")[:2]
                assert source in named or source.startswith("./")
                targets.add(target)
        assert declared.get(name, "/") in targets | {"/"}
    for name in ("worker", "webhooks"):  # a job's files go with the container that had them
        assert any(mount.startswith("/var/lib/meshmark:") for mount in SERVICES[name]["tmpfs"])
        assert "volumes" not in SERVICES[name]
    assert "api:/var/lib/meshmark" in SERVICES["api"]["volumes"]


def test_a_workers_memory_is_enough_for_a_job_and_its_files_and_its_threads_for_its_processors() -> None:
    worker = SERVICES["worker"]
    job = int(worker["environment"]["MESHMARK_JOB_MEMORY_LIMIT"])
    files = sum(int(size) << 30 for mount in worker["tmpfs"] for size in re.findall(r"size=(\d+)g", mount))
    template = 512 << 20
    assert job + files + template <= int(worker["mem_limit"].removesuffix("g")) << 30
    assert worker["environment"]["MESHMARK_JOB_THREADS"] == str(worker["cpus"])


def test_the_store_has_time_to_end_and_volumes_on_a_small_disk_too() -> None:
    store = SERVICES["store"]
    assert store["stop_grace_period"] == "60s"
    assert "-volume.preStopSeconds=0" in store["command"]  # else ten, and another ten for its filer
    assert "-master.electionTimeout=1s" in store["command"]  # else it is away for twenty seconds at each restart
    assert "-idleTimeout=5" in store["command"]  # else half a minute for connections between its parts
    assert "-master.volumeSizeLimitMB=512" in store["command"]
    assert "-volume.max=0" in store["command"]


@pytest.mark.parametrize(("works_after", "code"), [(0, 0), (3, 0), (None, 1)])
def test_the_bucket_is_there_or_the_step_fails(works_after: int | None, code: int, tmp_path: Path) -> None:
    """`weed shell` ends with 0 whatever its command came to."""
    weed, asked = tmp_path / "weed", tmp_path / "asked"
    weed.write_text(
        "#!/bin/sh\nread line\n"
        f'case "$line" in *create*) echo x >>{asked} ;; esac\n'
        f'[ "$(cat {asked} 2>/dev/null | wc -l)" -lt {60 if works_after is None else works_after} ]'
        " && { echo 'error: no filer'; exit 0; }\n"
        """case "$line" in *list*) printf '  another\\tsize:0\\n  meshmark\\tsize:0\\tchunk:0\\n' ;; esac\n"""
    )
    weed.chmod(0o755)
    (tmp_path / "sleep").write_text("#!/bin/sh\n")
    (tmp_path / "sleep").chmod(0o755)
    (script,) = SERVICES["bucket"]["command"]
    script = script.replace("$$", "$").replace("/usr/bin/weed", str(weed))
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = subprocess.run(
        [*SERVICES["bucket"]["entrypoint"], script],
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    if code:
        assert "no bucket named meshmark" in done.stderr
    assert SERVICES["api"]["depends_on"]["bucket"]["condition"] == "service_completed_successfully"


def test_only_the_sender_of_webhooks_calls_others_and_it_does_not_know_the_store() -> None:
    assert [name for name, service in SERVICES.items() if "out" in service["networks"]] == ["webhooks"]
    assert SERVICES["webhooks"]["secrets"] == ["meshmark_database_url", "meshmark_broker_url", "secrets-key"]
    assert SERVICES["webhooks"]["environment"].keys() == {
        "MESHMARK_METRICS_HOST",
        "MESHMARK_WEBHOOKS_METRICS_PORT",
        "MESHMARK_SECRETS_KEY",
    }


def test_the_signer_alone_has_the_key_and_nobody_else_runs_otherwise_beside_it() -> None:
    text = (ROOT / "docker" / "compose.credentials.yaml").read_text()
    added = yaml.safe_load(text)
    schema = json.loads((ROOT / "tests" / "data" / "compose-spec.json").read_text())
    jsonschema.Draft7Validator(schema).validate(added)
    signer = added["services"].pop("signer")
    assert {name for name, service in added["services"].items() if "c2pa-key.pem" in service["secrets"]} == set()
    for name, service in added["services"].items():
        assert service.keys() == {"environment", "secrets"}, name
        assert service["environment"].keys() == {"MESHMARK_C2PA_CHAIN"}
    assert signer["networks"] == ["back"]
    assert "c2pa-key.pem" in signer["secrets"]
    assert "meshmark_broker_url" not in signer["secrets"]
    hardened = ("read_only", "cap_drop", "security_opt", "init", "logging", "restart", "image")
    assert {key: signer[key] for key in hardened} == {key: SERVICES["webhooks"][key] for key in hardened}
    settings = {name: value for name, value in signer["environment"].items() if "S3" in name or "STORE" in name}
    assert settings.items() <= SERVICES["worker"]["environment"].items()
    assert signer["environment"].keys() <= {f"{PREFIX}{name.upper()}" for name in Settings.model_fields}


def test_what_is_secret_is_in_files_that_the_script_makes_once(secrets: Path) -> None:
    made = {path.name: path.read_text() for path in secrets.iterdir()}
    assert made.keys() == COMPOSE["secrets"].keys()
    assert {item["file"] for item in COMPOSE["secrets"].values()} == {f"./secrets/{name}" for name in made}
    assert stat.S_IMODE(secrets.stat().st_mode) == 0o700
    subprocess.run(["sh", ROOT / "docker" / "make-secrets.sh", secrets], check=True)
    assert {path.name: path.read_text() for path in secrets.iterdir()} == made
    assert (
        json.loads(made["store.json"])["identities"][0]["credentials"][0]["secretKey"]
        == made[f"{PREFIX.lower()}s3_secret_access_key"]
    )
    text = (ROOT / "docker" / "compose.yaml").read_text()
    assert not [content for content in made.values() if content in text]
    ignored = subprocess.run(["git", "check-ignore", "docker/secrets/any"], cwd=ROOT, check=False, capture_output=True)
    assert ignored.returncode == 0
    known = {f"{PREFIX.lower()}{name}" for name in Settings.model_fields}
    assert {name for name in made if name.startswith(PREFIX.lower())} <= known


def test_every_variable_is_a_setting() -> None:
    known = {f"{PREFIX}{name.upper()}" for name in Settings.model_fields}
    for name in ("api", "worker", "webhooks"):
        assert SERVICES[name]["environment"].keys() <= known


class Machine:
    """The servers of the compose file on loopback, with its passwords, and where they are instead."""

    def __init__(self, secrets: Path, postgres: Postgres, s3: S3, redis_port: int) -> None:
        self.metrics = {"api": free_port(), "worker": free_port()}
        self.folder = os.fspath(secrets)
        content = {path.name: path.read_text() for path in secrets.iterdir()}
        database = re.sub(
            r"(@)[^/]+/.*",
            rf"@127.0.0.1:{postgres.port}/{postgres.new_database().rpartition('/')[2]}",
            content["meshmark_database_url"],
        )
        self.secrets = {
            "database_url": database,
            "broker_url": content["meshmark_broker_url"].replace("redis:6379", f"127.0.0.1:{redis_port}"),
            "s3_access_key_id": content["meshmark_s3_access_key_id"],
            "s3_secret_access_key": content["meshmark_s3_secret_access_key"],
            "s3_endpoint": s3.url,
        }

    def environment(self, name: str, folder: Path) -> dict[str, str]:
        """The variables of a container, but for hosts, ports and the folder."""
        given = {key.removeprefix(PREFIX).lower(): value for key, value in SERVICES[name]["environment"].items()}
        given |= self.secrets | {"metrics_host": "127.0.0.1", "data_dir": os.fspath(folder / name)}
        if "secrets_key" in given:
            given["secrets_key"] = given["secrets_key"].replace("/run/secrets", self.folder)
        given["metrics_port" if name == "api" else "worker_metrics_port"] = str(self.metrics[name])
        return given | ({"host": "127.0.0.1"} if name == "api" else {})


@pytest.fixture
def machine(secrets: Path, postgres: Postgres, tmp_path: Path) -> Iterator[Machine]:
    port = free_port()
    assert SERVICES["redis"]["command"][1:] == ["/run/secrets/redis.conf", "--dir", "/data"]
    redis = [
        "redis-server",
        os.fspath(secrets / "redis.conf"),
        "--dir",
        os.fspath(tmp_path),
        "--port",
        str(port),
        "--bind",
        "127.0.0.1",
    ]
    identities = json.loads((secrets / "store.json").read_text())["identities"]
    with running(redis, {}, quiet=True), s3_server(*identities) as s3:
        s3.new_bucket("meshmark")
        yield Machine(secrets, postgres, s3, port)


def test_its_processes_with_its_settings_watermark_an_asset(machine: Machine, tmp_path: Path) -> None:
    api = Service(tmp_path, **machine.environment("api", tmp_path))
    worker = {f"{PREFIX}{key.upper()}": value for key, value in machine.environment("worker", tmp_path).items()}
    command = {name: [sys.executable, "-m", *SERVICES[name]["command"]] for name in ("api", "worker")}
    with ExitStack() as stack:
        stack.enter_context(api.running(command["api"]))
        stack.enter_context(running(command["worker"], worker))
        assert api.submit(CUBE).status_code == 401
        made = subprocess.run(
            [sys.executable, "-m", "service", "keys", "create", "--tenant", "acme", "--name", "test"],
            env=os.environ | api.environment,
            capture_output=True,
            text=True,
            check=True,
        )
        key = re.search(r"mm_\w+", made.stdout)
        assert key is not None
        api.client.headers["Authorization"] = f"Bearer {key[0]}"
        response = api.submit(CUBE, '{"text": "HI", "count": 1, "evaluate": "none"}')
        assert response.status_code == 202, response.text
        job = api.wait_for(response.headers["Location"], "succeeded")
        assert api.client.get(job["links"]["model"]).content.startswith(b"glTF")
        assert api.client.get("/readyz").status_code == 200
        probe = [sys.executable, *SERVICES["worker"]["healthcheck"]["test"][2:]]

        def healthy() -> bool:
            done = subprocess.run(probe, env=os.environ | worker, capture_output=True, check=False)
            return done.returncode == 0

        wait_until(healthy)
    assert not healthy()
