"""A client of the deployment: of `docker compose`, and of the API that it publishes."""

import http.client
import json
import re
import struct
import urllib.error
import urllib.request
import uuid
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.docker.commands import ROOT, Argument, FailedError, require, run, wait_until
from tests.docker.engine import Engine

PROJECT = "meshmark-test"
ADDRESS = ("127.0.0.1", 8080)
OURS = ("api", "worker", "webhooks")
ENDED = {"succeeded", "failed", "canceled", "expired"}
ASSET = ROOT / "tests" / "data" / "spot.glb"


@dataclass
class Client:
    """Of the API, with a key; remembers every job that was accepted."""

    key: str
    jobs: list[str] = field(default_factory=list)

    def ask(
        self, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> tuple[int, bytes]:
        """Status and body of an answer.

        Raises:
            OSError: there is none.
        """
        given = {"Authorization": f"Bearer {self.key}", **(headers or {})}
        request = urllib.request.Request(
            f"http://{ADDRESS[0]}:{ADDRESS[1]}{path}", data=body, method=method, headers=given
        )
        try:
            with urllib.request.urlopen(request, timeout=60) as response:
                return response.status, response.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()

    def is_up(self) -> bool:
        """Whether the API serves."""
        try:
            return self.ask("GET", "/healthz")[0] == 200
        except OSError:
            return False

    def submit(self, parameters: dict[str, Any], asset: bytes | None = None) -> str:
        """The id of a job that was accepted."""
        content = ASSET.read_bytes() if asset is None else asset
        status, said = self.send(parameters, len(content), [content])
        require(status == 202, f"an upload was answered with {status}: {said!r}")
        return self.accepted(said)

    def accepted(self, answer: bytes) -> str:
        """The id in an answer."""
        job = str(json.loads(answer)["id"])
        self.jobs.append(job)
        return job

    def send(self, parameters: dict[str, Any], size: int, content: Iterable[bytes]) -> tuple[int, bytes]:
        """What an upload, as a form (RFC 7578), is answered with."""
        line = f"--{uuid.uuid4()}"
        before = (
            f'{line}\r\nContent-Disposition: form-data; name="params"\r\n\r\n{json.dumps(parameters)}\r\n'
            f'{line}\r\nContent-Disposition: form-data; name="file"; filename="asset.glb"\r\n\r\n'
        ).encode()
        after = f"\r\n{line}--\r\n".encode()

        def body() -> Iterator[bytes]:
            yield before
            yield from content
            yield after

        connection = http.client.HTTPConnection(*ADDRESS, timeout=300)
        try:
            connection.request(
                "POST",
                "/v1/watermarks",
                body(),
                {
                    "Authorization": f"Bearer {self.key}",
                    "Content-Type": f"multipart/form-data; boundary={line[2:]}",
                    "Content-Length": str(len(before) + size + len(after)),
                },
            )
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def job(self, job: str) -> dict[str, Any]:
        """How it stands; an API that is briefly away is asked again."""
        found: dict[str, Any] = {}

        def answered() -> bool:
            try:
                status, body = self.ask("GET", f"/v1/watermarks/{job}")
            except OSError:
                return False
            require(status in (200, 503), f"job {job} was answered with {status}: {body!r}")
            if status == 200:
                found.update(json.loads(body))
            return bool(found)

        wait_until(f"job {job} is told of", answered)
        return found

    def state(self, job: str) -> str:
        """Its state."""
        return str(self.job(job)["state"])

    def wait_for(self, *jobs: str) -> list[dict[str, Any]]:
        """The jobs, once all have succeeded."""
        wait_until("all jobs end", lambda: all(self.state(job) in ENDED for job in jobs))
        ended = [self.job(job) for job in jobs]
        for found in ended:
            require(found["state"] == "succeeded", f"a job did not succeed: {found}")
        return ended

    def ends(self, job: str) -> list[str]:
        """The events by which a job ended."""
        status, body = self.ask("GET", f"/v1/watermarks/{job}/events")
        require(status == 200, f"the events of {job} were answered with {status}")
        events = re.findall(r"^event: watermark\.(\w+)", body.decode(), re.MULTILINE)
        return [event for event in events if event in ENDED]

    def at_once(self, count: int, parameters: dict[str, Any], asset: "LargeAsset") -> list[str]:
        """Jobs of so many large assets, sent at the same time."""
        with ThreadPoolExecutor(count) as pool:
            answers = list(
                pool.map(lambda number: self.send(parameters, asset.size, asset.content(number)), range(count))
            )
        refused = [(status, body[:300]) for status, body in answers if status != 202]
        require(not refused, f"{len(refused)} of {count} large uploads were refused: {refused}")
        return [self.accepted(body) for _, body in answers]


class LargeAsset:
    """A box as a GLB of nearly any size: most of it bytes that nothing refers to."""

    CORNERS = tuple((x, y, z) for x in (0.0, 2.0) for y in (0.0, 1.0) for z in (0.0, 1.5))
    FACES = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"

    def __init__(self, size: int) -> None:
        self.size = size - size % 4

    def content(self, number: int) -> Iterator[bytes]:
        """Its bytes; other ones for each number."""

        positions = b"".join(struct.pack("<3f", *corner) for corner in self.CORNERS)
        indices = b"".join(struct.pack("<H", int(index)) for index in self.FACES.split())
        buffer = positions + indices + struct.pack("<I", number)
        document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": 5126,
                    "count": 8,
                    "type": "VEC3",
                    "min": [0, 0, 0],
                    "max": [2, 1, 1.5],
                },
                {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": len(positions)},
                {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)},
            ],
        }
        length = 4096  # of the JSON, which names the length of all else
        binary = self.size - 12 - 8 - length - 8
        document["buffers"] = [{"byteLength": binary}]
        text = json.dumps(document).encode().ljust(length)
        yield struct.pack("<4sII", b"glTF", 2, self.size) + struct.pack("<I4s", length, b"JSON") + text
        yield struct.pack("<I4s", binary, b"BIN\0") + buffer
        left = binary - len(buffer)
        zeros = bytes(1 << 20)
        while left:
            yield zeros[:left]
            left -= min(left, len(zeros))


class Deployment:
    """The stack of the compose file, with secrets of its own and a file of hooks.

    Args:
        engine: that runs it.
        folder: for the secrets and what is added to the compose file.
    """

    def __init__(self, engine: Engine, folder: Path) -> None:
        self.engine = engine
        secrets = folder / "secrets"
        run(["sh", ROOT / "docker" / "make-secrets.sh", secrets])
        self.secrets = {path.name: path.read_text() for path in secrets.iterdir()}
        hooks = folder / "hooks.toml"
        hooks.write_text(
            '[sources.drop]\nkind = "s3"\ntoken = "0123456789abcdef0123456789abcdef"\nbucket = "drop"\n'
            'endpoint = "http://store:8333"\nregion = "us-east-1"\ntenant = "acme"\n'
            f'access_key_id = "{self.secrets["meshmark_s3_access_key_id"]}"\n'
            f'secret_access_key = "{self.secrets["meshmark_s3_secret_access_key"]}"\n'
            'input_prefix = "incoming/"\noutput_prefix = "watermarked/"\n'
            'parameters = { text = "dropped", count = 1, evaluate = "none" }\n'
        )
        hooks.chmod(0o444)
        with_hooks = {
            "environment": {"MESHMARK_HOOKS_FILE": "/run/secrets/hooks.toml"},
            "secrets": ["hooks.toml"],
        }
        added = {
            "services": {"api": with_hooks, "worker": with_hooks},
            "secrets": {name: {"file": f"{secrets}/{name}"} for name in self.secrets}
            | {"hooks.toml": {"file": f"{hooks}"}},
        }
        self._added = folder / "added.json"
        self._added.write_text(json.dumps(added))

    def compose(self, *arguments: Argument, check: bool = True, both: bool = False) -> str:
        """What `docker compose` says."""
        files = ("-p", PROJECT, "-f", ROOT / "docker" / "compose.yaml", "-f", self._added)
        return self.engine.docker("compose", *files, *arguments, check=check, both=both)

    def images(self) -> list[str]:
        """The images of others."""
        services = json.loads(self.compose("config", "--format", "json"))["services"]
        return sorted({service["image"] for service in services.values() if "build" not in service})

    def up(self, workers: int = 2) -> None:
        """Start all of it, or what has ended."""
        self.compose("up", "--detach", "--no-build", "--no-recreate", "--scale", f"worker={workers}", both=True)

    def containers(self, *services: str) -> list[str]:
        """Their ids; of all where none is named."""
        return self.compose("ps", "--all", "--quiet", *services).split()

    def inspect(self, container: str) -> dict[str, Any]:
        """What the engine knows of a container."""
        return dict(json.loads(self.engine.docker("inspect", container))[0])

    def healthy(self) -> bool:
        """Whether every container that says how it is says it is well."""
        states = [self.inspect(container)["State"] for container in self.containers()]
        return all(state.get("Health", {}).get("Status", "healthy") == "healthy" for state in states)

    def python(self, service: str, script: str, *arguments: str) -> str:
        """What a script says in a running container."""
        return self.compose("exec", "-T", service, "python", "-c", script, *arguments)

    def exit_codes(self) -> dict[str, int]:
        """By name, of all containers that have ended."""
        found = [self.inspect(container) for container in self.containers()]
        running = [item["Name"] for item in found if item["State"]["Running"]]
        require(not running, f"they run still: {running}")
        return {item["Name"].removeprefix(f"/{PROJECT}-"): int(item["State"]["ExitCode"]) for item in found}

    def log(self, container: str) -> list[dict[str, Any]]:
        """What a container of ours logged.

        Raises:
            FailedError: a line is no JSON.
        """
        lines = self.engine.docker("logs", container, both=True).splitlines()
        found = []
        for line in lines:
            try:
                found.append(json.loads(line))
            except ValueError:
                raise FailedError(f"{self.inspect(container)['Name']} logs what is no JSON: {line[:500]}") from None
        return found
