import hashlib
import http.client
import os
import re
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from core import models
from core.errors import ErrorCode, MeshmarkError
from core.models import MODELS, Model, State, cache_folder, fetch, find, listing, unreadable
from tests.worker.waiting import PATIENCE

CONTENT = bytes(range(256)) * 4000
NAME = "stand-in"


@dataclass
class Site:
    """A file on a web server with one of its moods, and what was asked of it."""

    content: bytes = CONTENT
    ranges: bool = True
    declares_length: bool = True
    break_after: list[int] = field(default_factory=list)  # bytes sent before each of the first answers breaks off
    redirect: str | None = None
    status: int = 200
    hang: threading.Event | None = None
    hold: threading.Event | None = None
    asked: list[str] = field(default_factory=list)
    url: str = ""


class Handler(BaseHTTPRequestHandler):
    site: Site

    def do_GET(self) -> None:
        site = self.site
        site.asked.append(self.headers["Range"] or "")
        if site.hang is not None:
            site.hang.wait(PATIENCE)
            return
        if site.redirect is not None and self.path != "/there":
            self.send_response(302)
            self.send_header("Location", site.redirect)
            self.end_headers()
            return
        if site.status != 200:
            self.send_error(site.status)
            return
        start = 0
        if site.ranges and (wanted := re.fullmatch(r"bytes=(\d+)-", self.headers["Range"] or "")):
            start = int(wanted[1])
            if start >= len(site.content):
                self.send_error(416)
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{len(site.content) - 1}/{len(site.content)}")
        else:
            self.send_response(200)
        if site.declares_length:
            self.send_header("Content-Length", str(len(site.content) - start))
        self.end_headers()
        if site.hold is not None:
            site.hold.wait(PATIENCE)
        body = site.content[start:]
        with suppress(ConnectionError):  # whoever asked may have seen enough
            self.wfile.write(body[: site.break_after.pop(0)] if site.break_after else body)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        pass


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Site]]:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    servers = []

    def start(site: Site) -> Site:
        handler = type("SiteHandler", (Handler,), {"site": site})
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, args=(0.01,)).start()
        servers.append(server)
        site.url = f"http://127.0.0.1:{server.server_port}/file"
        return site

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> Model:
    sha256 = hashlib.sha256(CONTENT).hexdigest()
    model = Model(NAME, "stand-in.onnx", ("http://127.0.0.1:9/none",), sha256, len(CONTENT), "Apache-2.0")
    monkeypatch.setitem(MODELS, NAME, model)
    return model


def refusal(folder: Path, url: str | None, timeout: float = PATIENCE) -> MeshmarkError:
    """What fetching says, having left no file under the model's name."""
    with pytest.raises(MeshmarkError) as caught:
        fetch(NAME, folder, url, timeout=timeout)
    assert caught.value.code is ErrorCode.MODEL_UNAVAILABLE
    assert not (folder / "stand-in.onnx").exists()
    return caught.value


def partial(folder: Path) -> Path:
    return folder / "stand-in.onnx.partial"


def test_a_model_is_downloaded_whole_and_then_found(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    seen: list[tuple[int, int]] = []
    path = fetch(NAME, folder, serve(Site()).url, progress=lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == CONTENT
    assert find(NAME, folder) == path
    assert not partial(folder).exists()
    assert seen == sorted(seen)
    assert seen[-1] == (len(CONTENT), len(CONTENT))


def test_an_installed_model_is_not_asked_for_again(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site())
    fetch(NAME, tmp_path, site.url)
    fetch(NAME, tmp_path, site.url)
    assert site.asked == [""]


def test_a_model_that_is_not_installed_is_not_found(tmp_path: Path) -> None:
    assert find(NAME, tmp_path) is None


@pytest.mark.parametrize("content", [CONTENT[:-1], CONTENT[:-1] + b"x", b""])
def test_a_damaged_model_is_refused_with_the_command_that_mends_it(
    content: bytes, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    (tmp_path / "stand-in.onnx").write_bytes(content)
    with pytest.raises(MeshmarkError) as caught:
        find(NAME, tmp_path)
    assert caught.value.code is ErrorCode.MODEL_UNAVAILABLE
    assert f"meshmark models fetch {NAME}" in caught.value.remedy
    assert fetch(NAME, tmp_path, serve(Site()).url).read_bytes() == CONTENT


def test_a_broken_transfer_goes_on_where_it_stopped(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(break_after=[300_000, 200_000]))
    assert fetch(NAME, tmp_path, site.url).read_bytes() == CONTENT
    assert site.asked == ["", "bytes=300000-", "bytes=500000-"]


def test_what_an_interrupted_download_left_is_used_by_the_next(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    def interrupt(done: int, _total: int) -> None:
        if done > 300_000:
            raise KeyboardInterrupt

    site = serve(Site())
    with pytest.raises(KeyboardInterrupt):
        fetch(NAME, tmp_path, site.url, progress=interrupt)
    left = partial(tmp_path).stat().st_size
    assert 0 < left < len(CONTENT)
    assert find(NAME, tmp_path) is None
    assert fetch(NAME, tmp_path, site.url).read_bytes() == CONTENT
    assert site.asked == ["", f"bytes={left}-"]


@pytest.mark.parametrize("declares_length", [True, False])
def test_a_server_without_ranges_sends_everything_again(
    declares_length: bool, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    partial(tmp_path).write_bytes(CONTENT[:1000])
    site = serve(Site(ranges=False, declares_length=declares_length))
    assert fetch(NAME, tmp_path, site.url).read_bytes() == CONTENT
    assert site.asked == ["bytes=1000-"]


def test_a_server_that_sends_another_range_is_refused(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    partial(tmp_path).write_bytes(CONTENT[:1000])
    site = serve(Site(content=CONTENT))

    def shifted(handler: Handler) -> None:
        handler.send_response(206)
        handler.send_header("Content-Range", f"bytes 1001-{len(CONTENT) - 1}/{len(CONTENT)}")
        handler.end_headers()
        handler.wfile.write(CONTENT[1001:])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Handler, "do_GET", shifted)
        assert "asked for bytes 1000-" in refusal(tmp_path, site.url).message
    assert partial(tmp_path).read_bytes() == CONTENT[:1000]


@pytest.mark.parametrize("left", [CONTENT + b"more", b"other" * 1000, b"x" * len(CONTENT)])
def test_a_wrong_or_too_long_partial_file_is_dropped(
    left: bytes, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    partial(tmp_path).write_bytes(left)
    assert fetch(NAME, tmp_path, serve(Site()).url).read_bytes() == CONTENT


def test_a_complete_partial_file_needs_no_server(tmp_path: Path) -> None:
    partial(tmp_path).write_bytes(CONTENT)
    assert fetch(NAME, tmp_path).read_bytes() == CONTENT


def test_another_file_of_the_same_size_is_refused_and_deleted(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(content=CONTENT[::-1]))
    assert "another SHA-256" in refusal(tmp_path, site.url).message
    assert not partial(tmp_path).exists()
    assert len(site.asked) == 1


@pytest.mark.parametrize("declares_length", [True, False])
def test_a_file_that_is_too_long_is_not_kept(
    declares_length: bool, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    site = serve(Site(content=CONTENT * 3, declares_length=declares_length))
    refusal(tmp_path, site.url)
    assert not partial(tmp_path).exists() or partial(tmp_path).stat().st_size == 0


def test_a_file_that_is_too_short_is_refused(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(content=b"version https://git-lfs.github.com/spec/v1"))
    assert f"42 bytes instead of {len(CONTENT)}" in refusal(tmp_path, site.url).message


def test_a_short_file_of_unknown_length_is_refused(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(content=CONTENT[:1000], declares_length=False))
    refusal(tmp_path, site.url)
    assert len(site.asked) <= models.ATTEMPTS


@pytest.mark.parametrize("status", [404, 403, 500])
def test_an_answer_that_is_no_file_is_reported_with_its_status(
    status: int, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    assert str(status) in refusal(tmp_path, serve(Site(status=status)).url).message


def test_a_server_that_says_nothing_is_left_after_the_timeout(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(hang=threading.Event()))
    assert "timed out" in refusal(tmp_path, site.url, timeout=0.1).message
    assert site.hang is not None
    site.hang.set()


def test_a_server_that_stops_in_the_middle_is_left_after_the_timeout(
    serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    site = serve(Site(hold=threading.Event()))
    assert "timed out" in refusal(tmp_path, site.url, timeout=0.1).message
    assert site.hold is not None
    site.hold.set()


def test_nobody_listening_is_reported(tmp_path: Path) -> None:
    assert "refused" in refusal(tmp_path, "http://127.0.0.1:9/none").message


def test_the_next_place_is_tried_and_goes_on_from_what_the_first_gave(
    serve: Callable[[Site], Site], stand_in: Model, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    missing, broken, good = serve(Site(status=404)), serve(Site(break_after=[1000, 0])), serve(Site())
    urls = (missing.url, broken.url, good.url)
    monkeypatch.setitem(MODELS, NAME, Model(**{**vars(stand_in), "urls": urls}))
    assert fetch(NAME, tmp_path).read_bytes() == CONTENT
    assert good.asked == ["bytes=1000-"]


def test_every_place_is_named_when_none_gives_the_file(
    serve: Callable[[Site], Site], stand_in: Model, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    urls = (serve(Site(status=404)).url, serve(Site(content=CONTENT[::-1])).url)
    monkeypatch.setitem(MODELS, NAME, Model(**{**vars(stand_in), "urls": urls}))
    error = refusal(tmp_path, None)
    assert "404" in error.message
    assert "SHA-256" in error.message
    assert str(tmp_path / "stand-in.onnx") in error.remedy


def test_a_redirect_to_another_safe_place_is_followed(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    target = serve(Site())
    site = serve(Site(redirect=target.url))
    partial(tmp_path).write_bytes(CONTENT[:1000])
    assert fetch(NAME, tmp_path, site.url).read_bytes() == CONTENT
    assert target.asked == ["bytes=1000-"]


@pytest.mark.parametrize("target", ["http://example.com/file", "ftp://127.0.0.1/file", "file:///etc/hostname"])
def test_a_redirect_to_an_unsafe_place_is_refused(target: str, serve: Callable[[Site], Site], tmp_path: Path) -> None:
    refusal(tmp_path, serve(Site(redirect=target)).url)


def test_a_redirect_that_leaves_https_is_refused() -> None:
    request = urllib.request.Request("https://example.com/file")
    with pytest.raises(models._UnusableError, match="from https to http"), open(os.devnull, "rb") as body:  # noqa: PTH123
        models._SafeRedirects().redirect_request(
            request, body, 302, "Found", http.client.HTTPMessage(), "http://127.0.0.1/file"
        )


@pytest.mark.parametrize(
    "url",
    [
        "http://example.com/file",
        "http://127.0.0.1.example.com/file",
        "http://localhost.example.com/file",
        "http://10.0.0.1/file",
        "file:///etc/hostname",
        "ftp://127.0.0.1/file",
        "https:///file",
        "stand-in.onnx",
    ],
)
def test_only_https_is_fetched_from_except_on_this_machine(url: str, tmp_path: Path) -> None:
    assert "https" in refusal(tmp_path, url).message


def test_of_two_fetching_at_once_one_works_and_both_get_the_file(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    site = serve(Site(hold=threading.Event()))
    paths: list[Path] = []
    threads = [threading.Thread(target=lambda: paths.append(fetch(NAME, tmp_path, site.url))) for _ in range(3)]
    for thread in threads:
        thread.start()
    assert site.hold is not None
    site.hold.set()
    for thread in threads:
        thread.join(PATIENCE)
    assert [path.read_bytes() for path in paths] == [CONTENT] * 3
    assert len(site.asked) == 1


def test_a_folder_that_cannot_be_written_is_reported(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(MeshmarkError) as caught:
        fetch(NAME, tmp_path / "file" / "models", serve(Site()).url)
    assert caught.value.code is ErrorCode.MODEL_UNAVAILABLE
    assert "MESHMARK_MODELS" in caught.value.remedy


@pytest.mark.parametrize("ask", [find, fetch])
def test_an_unknown_name_is_answered_with_the_known_ones(ask: Callable[..., object], tmp_path: Path) -> None:
    with pytest.raises(MeshmarkError) as caught:
        ask("resnet51", tmp_path)
    assert caught.value.code is ErrorCode.MODEL_UNAVAILABLE
    assert models.RESNET50.name in caught.value.remedy


def test_the_list_tells_installed_missing_and_corrupt(serve: Callable[[Site], Site], tmp_path: Path) -> None:
    def state() -> State:
        return {entry.model.name: entry.state for entry in listing(tmp_path)}[NAME]

    assert state() is State.MISSING
    (tmp_path / "stand-in.onnx").write_bytes(b"else")
    assert state() is State.CORRUPT
    fetch(NAME, tmp_path, serve(Site()).url)
    assert state() is State.INSTALLED
    assert [entry.path.parent for entry in listing(tmp_path)] == [tmp_path] * len(MODELS)


@pytest.mark.parametrize("shut", ["folder", "file"])
def test_a_file_that_cannot_be_read_counts_as_missing_and_it_is_said_why(
    shut: str, serve: Callable[[Site], Site], tmp_path: Path
) -> None:
    """As a worker's jobs, which are shut off from the data folder, find the weights in a home that lies there."""
    folder = tmp_path / "models"
    path = fetch(NAME, folder, serve(Site()).url)
    assert unreadable(NAME, folder) is None
    script = (
        "import os, sys, tempfile\n"
        "from dataclasses import astuple\n"
        "from pathlib import Path\n"
        "from core import models\n"
        "from worker import sandbox\n"
        "name, folder, private, size, sha256 = sys.argv[1:]\n"
        "model = models.Model(name, 'stand-in.onnx', (), sha256, int(size), 'Apache-2.0')\n"
        "models.MODELS[name] = model\n"
        "assert models.find(name, Path(folder)) is not None\n"
        "sandbox.enter(Path(tempfile.mkdtemp()), [Path(private)])\n"
        "assert models.find(name, Path(folder)) is None\n"
        "print([entry.state for entry in models.listing(Path(folder)) if entry.model is model][0])\n"
        "print(*astuple(models.unreadable(name, Path(folder))))\n"
    )
    private = folder if shut == "folder" else path
    arguments = [NAME, str(folder), str(private), str(len(CONTENT)), hashlib.sha256(CONTENT).hexdigest()]
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    state, said = done.stdout.splitlines()
    assert state == "unreadable"
    assert said.startswith(f"model_unavailable The model {NAME} was not used: {path} cannot be read")
    assert "MESHMARK_MODELS" in said


def test_the_cache_folder_is_ours_then_xdg_then_the_home_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("MESHMARK_MODELS", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == tmp_path / "home" / ".cache" / "meshmark" / "models"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache_folder() == tmp_path / "home" / ".cache" / "meshmark" / "models"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder() == tmp_path / "cache" / "meshmark" / "models"
    monkeypatch.setenv("MESHMARK_MODELS", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    assert find(NAME) is None


def test_every_model_is_pinned_and_fetched_over_https() -> None:
    for model in (models.RESNET50,):
        assert re.fullmatch("[0-9a-f]{64}", model.sha256)
        assert model.size > 0
        assert all(url.startswith("https://") and url.endswith(model.file) for url in model.urls)
