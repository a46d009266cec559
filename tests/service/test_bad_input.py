"""Every kind of bad input, sent to the whole service with the real engine: what comes back, how soon, at what cost."""

import json
import os
import re
import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import psutil
import pytest

from core.artwork.fonts import DEFAULT_FONT
from tests.core.artwork.fontsmith import SQUARE, growing, make_font
from tests.core.formats.samples import GLB, OBJ, OFF, PLY_ASCII, STL_ASCII, STL_BINARY, ply_binary
from tests.service.harness import Service
from tests.worker.waiting import wait_until

MIB = 2**20
ROOT = Path(__file__).parents[2]
SPOT = (ROOT / "tests" / "data" / "spot.glb").read_bytes()
MAX_UPLOAD = 1_000_000
# What an answer must not carry: paths, tracebacks, names of Python's exceptions.
INTERNALS = re.compile(
    rf"Traceback|\.py\b|site-packages|[a-z](Error|Exception)\b|(?<!\w)/(tmp|home|root|usr|var)/|{re.escape(os.fspath(ROOT))}"
)


def glb(document: dict[str, Any], size: int | None = None) -> bytes:
    """A GLB without a binary chunk, filled with blanks up to a size."""
    text = json.dumps({"asset": {"version": "2.0"}, **document}, separators=(",", ":")).encode()
    text = text.ljust(size - 20) if size else text + b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


def edited(data: bytes, old: bytes, new: bytes) -> bytes:
    assert old in data
    return data.replace(old, new, 1)


def rubble(side: int) -> bytes:
    """An OBJ of a square whose vertices lie at random heights."""
    height = np.random.default_rng(0).uniform(0, 4, (side, side))
    vertices = [f"v {x} {y} {height[x, y]:.1f}" for x in range(side) for y in range(side)]
    corner = [x * side + y + 1 for x in range(side - 1) for y in range(side - 1)]
    faces = [f"f {a} {a + side} {a + side + 1} {a + 1}" for a in corner]
    return "\n".join([*vertices, *faces, ""]).encode()


NAN, CORNER = struct.pack("<f", float("nan")), struct.pack("<3f", -1, -1, -1)
# A font of pictures only, as those of colour emoji are.
BITMAPS = make_font({"a": [SQUARE]}).replace(b"glyf", b"CBDT").replace(b"loca", b"CBLC")
HUGE = {
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"componentType": 5126, "type": "VEC3", "count": 100_000_000, "min": [0, 0, 0], "max": [1, 1, 1]}],
}
NEEDLE = b"v 0 0 0\nv 30 0 0\nv 30 0.05 0\nv 0 0.05 0\nf 1 2 3 4\n"


@dataclass(frozen=True)
class Request:
    """A POST with one thing wrong; what is not said is right."""

    code: str
    status: int = 422
    file: bytes | None = SPOT
    params: str | None = '{"text": "watermark"}'
    font: bytes | None = None
    logo: bytes | None = None
    raw: dict[str, Any] = field(default_factory=dict)  # the whole request, where it is no proper form
    says: str = ""

    def send(self, client: httpx2.Client) -> httpx2.Response:
        if self.raw:
            return client.post("/v1/watermarks", **self.raw)
        parts = {"file": ("asset.glb", self.file)} if self.file is not None else {}
        parts |= {"font": ("font.ttf", self.font)} if self.font is not None else {}
        parts |= {"logo": ("logo.svg", self.logo)} if self.logo is not None else {}
        data = {"params": self.params} if self.params is not None else {}
        return client.post("/v1/watermarks", files=parts or None, data=data)


def text(value: str, **others: Any) -> str:
    return json.dumps({"text": value, **others})


def svg(content: str) -> bytes:
    return f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 9'>{content}</svg>".encode()


SQUARES = f"<path d='{''.join(f'M{x / 8} {y / 8}h.1v.1h-.1z' for x in range(71) for y in range(71))}'/>"
DOUBLED = "<path id='x0' d='M0 0h9v9z'/>" + "".join(
    f"<g id='x{n + 1}'><use href='#x{n}'/><use href='#x{n}'/></g>" for n in range(20)
)


def with_parameter(name: str, value: str, says: str = "") -> Request:
    return Request("invalid_parameters", params=f'{{"text": "watermark", "{name}": {value}}}', says=says or name)


REFUSED_AT_ONCE = {
    "empty file": Request("empty_file", file=b""),
    "GLB cut in half": Request("truncated_file", file=SPOT[: len(SPOT) // 2]),
    "GLB cut in its header": Request("truncated_file", file=SPOT[:10]),
    "text renamed to .glb": Request("unknown_format", 415, file=b"Dear sir or madam, this is a letter.\n" * 9),
    "OBJ without faces": Request("no_faces", file=b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", says="3 vertices"),
    "STL of 4 billion triangles": Request("truncated_file", file=bytes(80) + b"\xff" * 4, says="4,294,967,295"),
    "GLB of 100 million vertices": Request("budget_exceeded", file=glb(HUGE, 308), says="100,000,000"),
    "file over the limit": Request("upload_too_large", 413, file=SPOT * 5, says="1,000,000"),
    "request over the limit": Request("upload_too_large", 413, file=bytes(40 * MIB)),
    "empty text": Request("empty_text", params=text("")),
    "only spaces": Request("empty_text", params=text(" \t\u3000 ")),
    "tabulator": Request("invalid_parameters", params=text("one\ttwo"), says="U+0009"),
    "zero-width space": Request("invalid_parameters", params=text("one\u200btwo"), says="U+200B"),
    "seven lines": Request("invalid_parameters", params=text("a\nb\nc\nd\ne\nf\ng"), says="text"),
    "unknown language": with_parameter("language", '"klingon"'),
    "unknown alignment": with_parameter("align", '"justified"'),
    "lines that overlap": with_parameter("line_spacing", "0.1"),
    "bitmap emoji font": Request("invalid_font", font=BITMAPS, says="bitmaps"),
    "font bomb": Request("invalid_font", font=growing(3), params=text("a"), says="glyphs of a letter"),
    "emoji that the font lacks": Request("missing_glyphs", params=text("hi \U0001f984"), says="U+1F984"),
    "text too long": Request("invalid_parameters", params=text("A" * 10_000), says="200"),
    "negative size": with_parameter("size", "-1"),
    "negative relief": with_parameter("relief", "-0.1"),
    "negative count": with_parameter("count", "-4"),
    "fractional count": with_parameter("count", "1.5"),
    "NaN size": with_parameter("size", "NaN"),
    "infinite relief": with_parameter("relief", "Infinity"),
    "seed beyond a float": with_parameter("seed", "1e999"),
    "size as a word": with_parameter("size", '"big"'),
    "unknown parameter": with_parameter("colour", '"#ff0000"'),
    "bad colour": with_parameter("color", '"#ff00"', says="hexadecimal"),
    "unknown preset": with_parameter("preset", '"gift"', says="merchandise"),
    "unknown label": with_parameter("label", '"fr"', says="us-ca"),
    "text that is not what its label says": with_parameter("label", '"cn"', says="生成"),
    "label in letters that no font has": Request(
        "missing_glyphs", params=text("AI \U0001f985", label="eu"), says="U+1F985"
    ),
    "nothing but a label, and none": with_parameter("metadata_only", "true", says="label"),
    "statement of two lines": with_parameter("declaration", '{"creator": "a\\nb"}', says="declaration.creator"),
    "unknown statement": with_parameter("declaration", '{"maker": "me"}', says="declaration.maker"),
    "time that is none": with_parameter("declaration", '{"created": "soon"}', says="declaration.created"),
    "AIGC label that is no object": with_parameter("declaration", '{"aigc": "{}"}', says="declaration.aigc"),
    "region of no kind": with_parameter("keep_out", '[{"part": "Head"}]', says="keep_out.0"),
    "region of two kinds": with_parameter("keep_out", '[{"node": "Head", "material": "Skin"}]', says="exactly one"),
    "box inside out": with_parameter("prefer", '[{"box": {"min": [1, 1, 1], "max": [0, 2, 2]}}]', says="prefer.0.box"),
    "negative seed": with_parameter("seed", "-1"),
    "broken JSON": Request("invalid_parameters", params='{"text": "wat', says="JSON"),
    "JSON of another kind": Request("invalid_parameters", params='["watermark"]', says="object"),
    "no parameters": Request("invalid_request", 400, params=None, says="params"),
    "SVG bomb": Request("invalid_logo", logo=svg(f"{DOUBLED}<use href='#x20'/>"), says="elements"),
    "SVG with entities": Request("invalid_logo", logo=b"<!DOCTYPE svg [<!ENTITY a 'b'>]>" + svg(""), says="entities"),
    "SVG with a script": Request("invalid_logo", logo=svg("<script/>"), says="script"),
    "SVG of another file": Request("invalid_logo", logo=svg("<use href='http://a.example/b.svg#c'/>"), says="file"),
    "SVG without a filled area": Request("invalid_logo", logo=svg("<path d='M0 0L9 9'/>"), says="no filled area"),
    "SVG of too many points": Request("invalid_logo", logo=svg(SQUARES), says="20,164 points; at most 20,000"),
    "no SVG": Request("invalid_logo", logo=b"Dear sir or madam", says="well-formed"),
    "QR text too long to be read": with_parameter("qr", json.dumps("https://a.example/" + "x" * 100), "version 6"),
    "QR text too long for its size": Request(
        "invalid_parameters", params='{"qr": "https://a.example", "size": 1}', says="`size` of 1 "
    ),
    "QR code too small beside a text": Request(
        "invalid_parameters", params=text("watermark", qr="https://a.example", size=5), says="`size` of 5."
    ),
    "QR code too small in the size of a preset": Request(
        "invalid_parameters",
        params=text("", qr="https://a.example/" + "x" * 80, preset="provenance"),
        says="`size` of 3 ",
    ),
    "QR text that is no address": with_parameter("qr", '"javascript:alert(1)"'),
    "logo and QR code": Request(
        "invalid_parameters", logo=svg("<path d='M0 0h9v9z'/>"), params='{"qr": "https://a.example"}', says="both"
    ),
    "broken font": Request("invalid_font", font=DEFAULT_FONT.read_bytes()[:5000], says="cut off"),
    "font of another kind": Request("invalid_font", font=b"Dear sir or madam", says="TrueType"),
    "no file": Request("missing_file", file=None, says="file"),
    "JSON in place of a form": Request("unsupported_media_type", 415, raw={"json": {}}, says="application/json"),
    "form without a boundary": Request(
        "invalid_request", 400, raw={"content": b"--x", "headers": {"Content-Type": "multipart/form-data"}}
    ),
}  # fmt: skip

FAILED_JOBS = {
    "NaN in a GLB": ("non_finite_positions", edited(GLB, CORNER, NAN * 3)),
    "NaN in a binary STL": ("non_finite_positions", edited(STL_BINARY, CORNER, NAN * 3)),
    "NaN in a text STL": ("non_finite_positions", edited(STL_ASCII, b"vertex -1 -1 -1", b"vertex -1 nan -1")),
    "NaN in an OBJ": ("non_finite_positions", edited(OBJ, b"v -1 -1 -1", b"v -1 nan -1")),
    "NaN in a text PLY": ("non_finite_positions", edited(PLY_ASCII, b"-1 -1 -1", b"-1 nan -1")),
    "NaN in a binary PLY": ("non_finite_positions", edited(ply_binary("<"), CORNER, NAN * 3)),
    "NaN in an OFF": ("non_finite_positions", edited(OFF, b"-1 -1 -1", b"-1 nan -1")),
    "index out of range in a GLB": (
        "index_out_of_range",
        edited(GLB, struct.pack("<3H", 0, 1, 3), struct.pack("<3H", 0, 1, 99)),
    ),
    "index out of range in an OBJ": ("index_out_of_range", edited(OBJ, b"f 1 3 7", b"f 1 3 99")),
    "index zero in an OBJ": ("index_out_of_range", edited(OBJ, b"f 1 3 7", b"f 1 3 0")),
    "index out of range in a PLY": ("index_out_of_range", edited(PLY_ASCII, b"4 0 1 3 2", b"4 0 1 3 99")),
    "index out of range in an OFF": ("index_out_of_range", edited(OFF, b"4 0 1 3 2", b"4 0 1 3 99")),
    "all vertices in one point": ("no_faces", re.sub(rb"v .*", b"v 1 1 1", OBJ)),
    "mesh too small": ("no_placement", NEEDLE),
    "mesh too rough": ("no_placement", rubble(150)),
}


class Meter:
    """The resident memory of a process and all it started, looked at some hundred times a second."""

    def __init__(self, pid: int) -> None:
        self.process = psutil.Process(pid)

    def resident(self) -> int:
        total = 0
        for process in [self.process, *self.process.children(recursive=True)]:
            try:
                total += process.memory_info().rss
            except psutil.NoSuchProcess:
                continue
        return total

    @contextmanager
    def peak(self) -> Iterator[list[int]]:
        """The highest value, in a list that is filled when the block ends."""
        peak, done = [self.resident()], threading.Event()

        def watch() -> None:
            while not done.wait(0.005):
                peak[0] = max(peak[0], self.resident())

        thread = threading.Thread(target=watch)
        thread.start()
        try:
            yield peak
        finally:
            done.set()
            thread.join()


@dataclass
class Running:
    """The embedded service with the real engine, warmed up, and what it holds when it is idle."""

    service: Service
    meter: Meter
    idle: int


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    service = Service(
        tmp_path_factory.mktemp("bad-input"),
        lease_seconds="15",
        max_upload_bytes=str(MAX_UPLOAD),
        job_time_limit="60",
    )
    with service.running([sys.executable, "-m", "service"]) as [process]:
        service.wait_for(service.submit(FAILED_JOBS["NaN in an OBJ"][1]).headers["Location"], "failed")
        meter = Meter(process.pid)
        wait_until(lambda: len(meter.process.children(recursive=True)) == 4)  # worker, sender, two templates; no engine
        yield Running(service, meter, meter.resident())


def plain(words: str) -> bool:
    """Whether this is a sentence without anything of our insides."""
    return words.endswith(".") and " " in words and not INTERNALS.search(words)


@pytest.mark.parametrize("name", REFUSED_AT_ONCE)
def test_what_is_wrong_at_sight_is_refused_at_once_and_within_500_mb(running: Running, name: str) -> None:
    request = REFUSED_AT_ONCE[name]
    with running.meter.peak() as peak:
        response = request.send(running.service.client)
    problem = response.json()
    assert (response.status_code, problem["code"], problem["status"]) == (request.status, request.code, request.status)
    assert response.headers["Content-Type"] == "application/problem+json"
    assert set(problem) == {"type", "title", "status", "detail", "code", "remedy"}
    assert request.says in problem["detail"]
    assert plain(problem["detail"]), problem
    assert plain(problem["remedy"]), problem
    assert not INTERNALS.search(response.text)
    assert peak[0] - running.idle < 500 * MIB


@pytest.mark.parametrize("name", FAILED_JOBS)
def test_what_shows_when_the_asset_is_read_fails_the_job_with_the_same_fields(running: Running, name: str) -> None:
    code, content = FAILED_JOBS[name]
    client = running.service.client
    with running.meter.peak() as peak:
        response = running.service.submit(content, params=text("watermark"))
        assert response.status_code == 202, response.text
        url = response.headers["Location"]
        job = running.service.wait_for(url, "failed")
    assert (job["error"]["code"], job["attempts"]) == (code, 1)
    assert set(job["error"]) == {"code", "title", "detail", "remedy"}
    assert plain(job["error"]["detail"]), job
    assert plain(job["error"]["remedy"]), job
    for part in ("", "/model", "/report", "/preview"):
        assert not INTERNALS.search(client.get(url + part).text)
    assert client.get(f"{url}/model").json()["code"] == "job_failed"
    if code != "no_placement":  # read without torch, and so within the same bound
        assert peak[0] - running.idle < 500 * MIB


def test_each_of_these_is_told_in_a_sentence_of_its_own(running: Running) -> None:
    answers = [request.send(running.service.client).json()["detail"] for request in REFUSED_AT_ONCE.values()]
    # One sentence names both of "empty text" and "only spaces", and one of the two regions that are of no one kind.
    assert len(set(answers)) == len(answers) - 2


def test_after_all_this_a_sound_asset_is_watermarked(running: Running) -> None:
    for request in REFUSED_AT_ONCE.values():
        request.send(running.service.client)
    response = running.service.submit(SPOT, params='{"text": "watermark", "count": 4}')
    job = running.service.wait_for(response.headers["Location"], "succeeded")
    report = running.service.client.get(job["links"]["report"]).json()
    assert len(report["watermarks"]) == 4
    stored = Path(running.service.environment["MESHMARK_DATA_DIR"])
    assert not list(stored.rglob(".staged-*"))
    assert not list((stored / "scratch").iterdir())
