"""Drills of the deployment: work, faults, and an end that leaves nothing behind."""

import json
import re
import shlex
import shutil
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from tests.docker.commands import FailedError, require, run, say, wait_until
from tests.docker.deployment import ASSET, ENDED, OURS, PROJECT, Client, Deployment, LargeAsset
from tests.docker.engine import Engine
from tests.manual import command_lines, page

MIB = 1 << 20
BUCKET = """
import sys, obstore
from pathlib import Path
from obstore.store import S3Store
key, secret = (Path(f"/run/secrets/meshmark_s3_{name}").read_text() for name in ("access_key_id", "secret_access_key"))
bucket = S3Store("drop", endpoint="http://store:8333", region="us-east-1", access_key_id=key, secret_access_key=secret,
                 client_options={"allow_http": True})
match sys.argv[1:]:
    case ["put", name]:
        obstore.put(bucket, name, sys.stdin.buffer.read())
    case ["list"]:
        print(*sorted(item["path"] for page in obstore.list(bucket) for item in page), sep="\\n")
"""
REACH = """
import socket, sys
from concurrent.futures import ThreadPoolExecutor
def reached(address):
    with socket.socket() as probe:
        probe.settimeout(2)
        return not probe.connect_ex((address, int(sys.argv[1])))
with ThreadPoolExecutor(32) as pool:
    print(*(address for address, is_it in zip(sys.argv[2:], pool.map(reached, sys.argv[2:])) if is_it), sep="\\n")
"""


def everything_measured(client: Client, weights: str | None) -> str:
    """A job with all metrics."""
    job = client.submit({"text": "watermark", "color": "#d02020"})
    client.wait_for(job)
    report = json.loads(client.ask("GET", f"/v1/watermarks/{job}/report")[1])
    metrics = report["metrics"]
    require(not metrics["missing"], f"metrics are missing: {metrics['missing']}")
    require(not report["warnings"], f"the report warns: {report['warnings']}")
    ocr = metrics["watermark_quality"]["ocr"]
    require(ocr > 0.8, f"the text is not read: {ocr}")
    require(metrics["semantics"] == (weights or "hog-color-layout"), f"ss is by {metrics['semantics']}")
    for kind, magic in (("model", b"glTF"), ("preview", b"\x89PNG")):
        status, content = client.ask("GET", f"/v1/watermarks/{job}/{kind}")
        require(status == 200 and content.startswith(magic), f"the {kind} is none")
    return f"{len(report['watermarks'])} marks, OCR {ocr:.2f}, ss by {metrics['semantics']}, no metric missing"


def hook(stack: Deployment, client: Client) -> str:
    """An object that is dropped in a bucket of the same store as the artifacts."""
    stack.compose(
        *("exec", "-T", "store", "sh", "-c", "echo 's3.bucket.create -name drop' | weed shell -master=store:9333")
    )
    # What is dropped is in the image's reach only: it goes by the standard input of a process in the API's container.
    command = [
        "sh",
        "-c",
        f"exec docker exec -i {stack.containers('api')[0]} python -c {shlex.quote(BUCKET)} put "
        f"incoming/spot.glb <{shlex.quote(str(ASSET))}",
    ]
    run(command, stack.engine.environment)
    told = {
        "Records": [
            {
                "eventName": "s3:ObjectCreated:Put",
                "s3": {"bucket": {"name": "drop"}, "object": {"key": "incoming/spot.glb"}},
            }
        ]
    }
    status, body = client.ask(
        "POST",
        "/v1/hooks/drop",
        json.dumps(told).encode(),
        {"Authorization": "Bearer 0123456789abcdef0123456789abcdef", "Content-Type": "application/json"},
    )
    require(status == 202, f"the notification was answered with {status}: {body!r}")
    (job,) = re.findall(r"[0-9a-f]{8}-(?:[0-9a-f]{4}-){3}[0-9a-f]{12}", body.decode())[:1]
    client.jobs.append(job)
    client.wait_for(job)
    wanted = {f"watermarked/spot.glb.{kind}" for kind in ("watermarked.glb", "report.json")}
    wait_until("its results are in the bucket", lambda: wanted <= set(stack.python("api", BUCKET, "list").splitlines()))
    return "results written back"


def large_uploads(client: Client) -> str:
    """Seven at once; they are spooled, stored and worked on."""
    jobs = client.at_once(7, {"text": "large", "count": 1, "evaluate": "none"}, LargeAsset(198 * MIB))
    client.wait_for(*jobs)
    return "7 of 7 times 198 MiB accepted and watermarked"


def killed_worker(stack: Deployment, client: Client) -> str:
    """One of two workers is killed while it has a job."""
    jobs = [client.submit({"text": f"killed {number}", "evaluate": "geometry"}) for number in range(3)]

    def at_work() -> list[str]:
        """The containers of workers that have begun one of the jobs and not ended it."""
        found = []
        for container in stack.containers("worker"):
            lines = [line for line in stack.log(container) if line.get("job") in jobs]
            begun = {line["job"] for line in lines if line["event"] == "job started"}
            if begun - {line["job"] for line in lines if line["event"] in ("job succeeded", "job failed")}:
                found.append(container)
        return found

    wait_until("both workers have a job", lambda: len(at_work()) == 2)
    stack.engine.docker("kill", at_work()[0])
    attempts = sorted(job["attempts"] for job in client.wait_for(*jobs))
    require(attempts == [1, 1, 2], f"attempts of the three jobs: {attempts}")
    stack.up()  # the worker is back
    return "its job taken up by the other (attempt 2), the other two at attempt 1"


def restarted(stack: Deployment, client: Client, service: str) -> str:
    """A server is restarted while jobs wait and run."""
    jobs = _in_flight(client, service)
    stack.compose("restart", service, both=True)
    ended = client.wait_for(*jobs)
    return f"{len(jobs)} jobs succeeded, attempts {sorted({job['attempts'] for job in ended})}"


def stopped_and_started(stack: Deployment, client: Client) -> str:
    """All of it, well after all that was done to it, is stopped while jobs wait and run, and started again."""
    wait_until("all are well", stack.healthy)
    jobs = _in_flight(client, "stop")
    stack.compose("stop", both=True)
    codes = stack.exit_codes()
    require(not any(codes.values()), f"exit codes: {codes}")
    stack.compose("start", both=True)
    wait_until("the API serves", client.is_up)
    ended = client.wait_for(*jobs)
    return (
        f"all {len(codes)} exit codes 0; {len(jobs)} jobs succeeded, attempts {sorted({j['attempts'] for j in ended})}"
    )


def _in_flight(client: Client, name: str) -> list[str]:
    """Four jobs, of which at least one runs."""
    jobs = [client.submit({"text": name, "seed": number, "count": 4, "evaluate": "none"}) for number in range(4)]
    wait_until("a job runs", lambda: any(client.state(job) == "running" for job in jobs))
    waiting = [job for job in jobs if client.state(job) not in ENDED]
    require(len(waiting) > 1, "no jobs are in flight any more")
    return jobs


@contextmanager
def _listener() -> Iterator[int]:
    """The port of a server on all addresses of this machine."""
    with closing(socket.create_server(("0.0.0.0", 0))) as server:
        threading.Thread(target=_accept, args=(server,), daemon=True).start()
        yield int(server.getsockname()[1])


def _accept(server: socket.socket) -> None:
    while True:
        try:
            server.accept()[0].close()
        except OSError:
            return


def no_way_to_the_host(stack: Deployment) -> str:
    """Workers reach nothing that this machine serves, by any address; the sender of webhooks, who may, does."""
    networks = json.loads(stack.engine.docker("network", "inspect", *_networks(stack)))
    gateways = [config["Gateway"] for item in networks for config in item["IPAM"]["Config"] if config.get("Gateway")]
    own = re.findall(r"inet (\d+\.\d+\.\d+\.\d+)", run(["ip", "-o", "-4", "address"]))
    addresses = sorted({*gateways, *own} - {"127.0.0.1"})
    with _listener() as port:
        for container in stack.containers("worker"):
            reached = stack.engine.docker("exec", container, "python", "-c", REACH, str(port), *addresses)
            require(not reached.split(), f"a worker reaches this machine at {reached.split()}")
        require(stack.python("webhooks", REACH, str(port), *addresses).split(), "the listener is reached by nobody")
    for container in stack.containers("worker"):
        require(
            any(line.get("files") is True and line.get("network") is True for line in stack.log(container)),
            "the sandbox is not in force",
        )
    return f"{len(addresses)} addresses tried from each worker, none answered; sandbox in force"


def _networks(stack: Deployment) -> list[str]:
    lines = stack.engine.docker("network", "ls", "--format", "{{.Name}}").splitlines()
    return [name for name in lines if name.startswith(PROJECT)]


def logs(stack: Deployment) -> str:
    """JSON throughout; each process says that it is ready; no noise."""
    count = 0
    for service in OURS:
        for container in stack.containers(service):
            lines = stack.log(container)
            count += len(lines)
            starts = sum(line["event"] == "ready" for line in lines)
            require(starts, f"{service} never says that it is ready")
            for line in lines:
                text = json.dumps(line)
                require("shader cache" not in text, f"{service} logs of a shader cache: {text}")
                require("Pool disposed" not in text, f"{service} logs of its pools: {text}")
                probe = line.get("path") in ("/healthz", "/readyz") and line.get("status") == 200
                require(not probe, f"{service} logs its probes: {text}")
    return f"{count} lines, all JSON, with ready, without probes and pools"


def ended_once(client: Client) -> str:
    """Every job that was accepted ended once, and what it made is there."""
    for job in client.jobs:
        ends = client.ends(job)
        require(ends == ["succeeded"], f"job {job} ended by {ends}")
        status, content = client.ask("GET", f"/v1/watermarks/{job}/model")
        require(status == 200 and content.startswith(b"glTF"), f"the model of {job} is lost ({status})")
    return f"{len(client.jobs)} jobs accepted, each succeeded once, every model there"


def taken_down(stack: Deployment) -> str:
    """Everything ends well, and the named volumes alone are left."""
    stack.compose("stop", both=True)
    codes = stack.exit_codes()
    require(not any(codes.values()), f"exit codes: {codes}")
    stack.compose("down", both=True)
    left = stack.engine.docker("ps", "--all", "--quiet")
    require(not left, f"containers are left: {left}")
    require(not _networks(stack), "networks are left")
    volumes = stack.engine.docker("volume", "ls", "--quiet").split()
    require(
        sorted(volumes) == sorted(f"{PROJECT}_{name}" for name in ("api", "postgres", "redis", "store")),
        f"volumes: {volumes}",
    )
    stack.compose("down", "--volumes", both=True)
    return f"all {len(codes)} exit codes 0; four named volumes and nothing else left"


def one_container(engine: Engine, tag: str, folder: Path) -> str:
    """The manual's lines, as they stand there."""
    engine.docker("tag", tag, "meshmark")
    text = command_lines(page("deployment"))
    (start,) = re.findall(r"^docker run -d .*", text, re.MULTILINE)
    (make_key,) = re.findall(r"^docker exec meshmark .*", text, re.MULTILINE)
    (apply,) = re.findall(r"^docker run --rm .*", text, re.MULTILINE)
    # Where the engine is not the usual one its client must be told; where it is, this changes nothing.
    environment = engine.environment
    run(["sh", "-c", start], environment)
    try:
        client = Client("")
        wait_until("the container serves", client.is_up)
        client.key = run(["sh", "-c", make_key], environment).strip()
        require(client.ask("GET", "/v1/watermarks", None, {"Authorization": ""})[0] == 401, "it asks for no key")
        job = client.submit({"text": "alone", "count": 2, "evaluate": "none"})
        client.wait_for(job)
        engine.docker("restart", "meshmark")
        wait_until("the container serves again", client.is_up)
        ended_once(client)
        engine.docker("stop", "meshmark")
        state = json.loads(engine.docker("inspect", "meshmark"))[0]["State"]
        require(state["ExitCode"] == 0, f"its exit code is {state['ExitCode']}")
    except FailedError:
        say(engine.docker("logs", "--tail", "50", "meshmark", check=False, both=True))
        raise
    finally:
        engine.docker("rm", "--force", "meshmark", check=False)
        engine.docker("volume", "rm", "meshmark", check=False)
    left = engine.docker("volume", "ls", "--quiet")
    require(not left, f"volumes are left: {left}")
    work = folder / "work"
    work.mkdir(exist_ok=True)
    shutil.copy(ASSET, work / "in.glb")
    run(["sh", "-c", apply], environment, cwd=work)
    require((work / "out.glb").read_bytes().startswith(b"glTF"), "the command line wrote no GLB")
    return "hardened, by the manual's own lines: key, job, restart, exit code 0; the command line without a network"


def one_processor(engine: Engine, tag: str) -> str:
    """A container that may use one processor of several knows it."""
    script = "from core.processors import available_processors; print(available_processors())"
    said = engine.docker("run", "--rm", "--network", "none", "--cpus", "1", "--entrypoint", "python", tag, "-c", script)
    require(said == "1", f"a container of one processor takes itself to have {said}")
    return "seen by the process in it"


Drill = Callable[[], str]
