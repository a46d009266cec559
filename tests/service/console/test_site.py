import json
import os
import re
import tomllib
from base64 import b64encode
from collections.abc import Iterator
from fnmatch import fnmatch
from hashlib import sha256
from pathlib import Path

import pytest

from core.errors import ErrorCode
from core.notices import NoticeCode
from service.config import Settings
from service.console.site import FOLDER, NAMED, PREFIX, STATIC, require_console, site, sources
from service.errors import ServiceErrorCode
from tests.service.conftest import Client, client_with

ROOT = Path(__file__).parents[3]
MODULES = [path for path in STATIC.glob("*.js") if not path.name.startswith("text-")]
IMPORT = re.compile(r"""^(?:import|export|\})[^;\n]*\bfrom\s*["']([^"']+)|\bimport\(["']([^"']+)""", re.MULTILINE)


def table(language: str) -> dict[str, str]:
    text = (STATIC / f"text-{language}.js").read_text()
    pairs = json.loads(text.removeprefix("export default ").rstrip(";\n"), object_pairs_hook=list)
    assert len(pairs) == len({key for key, _ in pairs}), "each key stands there once"
    return dict(pairs)


def test_the_page_says_which_files_it_is_made_of_and_runs_nothing_else(client: Client) -> None:
    answer = client.http.get("/")
    assert answer.status_code == 200
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert answer.headers["Cache-Control"] == "no-cache"
    policy = dict(part.split(" ", 1) for part in answer.headers["Content-Security-Policy"].split("; "))
    (import_map,) = re.findall(r'<script type="importmap">(.*?)</script>', answer.text)
    digest = b64encode(sha256(import_map.encode()).digest()).decode()
    assert policy["script-src"] == f"'self' 'sha256-{digest}'"
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert policy["connect-src"] == policy["img-src"] == "'self' blob:"
    assert "unsafe" not in str(policy)
    assert not re.search(r"<script(?![^>]*importmap)[^>]*>[^<]", answer.text), "no other script stands in the page"
    assert not re.search(r"\s(?:style|on\w+)=", answer.text)
    for link in re.findall(r'(?:href|src)="([^"]+)"', answer.text):
        assert client.http.get(link).status_code == 200, link


def test_results_may_come_from_the_bucket_that_presigned_links_lead_to(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(client.artifacts), "link", lambda _, sha256: f"https://b.example:9000/p/{sha256}?X=1")
    policy = client.http.get("/").headers["Content-Security-Policy"]
    assert "connect-src 'self' https://b.example:9000 blob:;" in policy
    assert "img-src 'self' https://b.example:9000 blob:;" in policy
    assert policy.count("b.example") == 2


def test_files_are_kept_for_ever_since_another_content_has_another_name(client: Client) -> None:
    for path, file in site().files.items():
        (digest,) = re.findall(r"\.([0-9a-f]{12})\.\w+$", path)
        assert sha256(file.content).hexdigest().startswith(digest)
    path = next(path for path in site().files if "main" in path)
    answer = client.http.get(path, headers={"Accept-Encoding": "gzip"})
    assert "immutable" in answer.headers["Cache-Control"]
    assert answer.headers["Content-Encoding"] == "gzip"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.content == site().files[path].content, "unpacked by the client"
    plain = client.http.get(path, headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers
    assert plain.content == answer.content
    again = client.http.get(path, headers={"If-None-Match": answer.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")
    head = client.http.head(path)
    assert (head.status_code, head.content) == (200, b"")
    gone = client.http.get(f"{PREFIX}main.0123456789ab.js")
    assert (gone.status_code, gone.json()["code"]) == (404, "not_found")


def test_every_module_that_is_imported_is_there() -> None:
    files = sources()
    found = set()
    for path, file in files.items():
        for names in IMPORT.findall(file.read_text()) if file.suffix in (".js", ".mjs") else ():
            name = "".join(names)
            found.add(name)
            beside = os.path.normpath(Path(path).parent / name)
            assert beside in files if name.startswith(".") else name in NAMED, (path, name)
    assert {"three", "./viewer.js", "../utils/BufferGeometryUtils.js"} <= found


def test_our_modules_name_no_other_host_and_make_no_markup() -> None:
    for path in [*MODULES, STATIC / "index.html", STATIC / "style.css"]:
        text = path.read_text()
        assert not re.findall(r"https?://(?!www\.w3\.org/)", text), path.name
        assert not re.findall(r"innerHTML|outerHTML|insertAdjacent|document\.write|\beval\(|new Function", text), (
            path.name
        )


def test_both_languages_say_the_same_things() -> None:
    english, chinese = table("en"), table("zh")
    assert list(english) == list(chinese)
    for key, text in english.items():
        assert set(re.findall(r"\{\w+\}", text)) == set(re.findall(r"\{\w+\}", chinese[key])), key
        assert text, key


def said() -> Iterator[str]:
    for path in MODULES:
        yield from re.findall(r'\bt\(\s*"([\w.-]+)"', path.read_text())


def test_every_text_that_is_shown_is_in_the_tables() -> None:
    assert set(said()) <= table("en").keys()


def test_every_code_of_the_service_has_words_in_both_languages() -> None:
    codes = {f"code.{code}" for codes in (ErrorCode, ServiceErrorCode, NoticeCode) for code in codes}
    for language in ("en", "zh"):
        assert {key for key in table(language) if key.startswith("code.")} == codes


def test_the_sample_is_the_demo_asset() -> None:
    assert (STATIC / "spot.glb").read_bytes() == (ROOT / "tests" / "data" / "spot.glb").read_bytes()


def test_the_console_can_be_left_out(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, console=False)) as client:
        for path in ("/", next(iter(site().files))):
            assert client.http.get(path).status_code == 404
        assert client.http.get("/healthz").status_code == 200


def test_the_console_is_no_part_of_the_described_api(client: Client) -> None:
    assert "/" not in client.http.get("/openapi.json").json()["paths"]


def test_without_its_libraries_nothing_starts_and_the_reason_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("service.console.site.site", lambda: site(tmp_path))
    require_console(Settings(data_dir=tmp_path, console=False))
    with pytest.raises(SystemExit) as ended:
        require_console(Settings(data_dir=tmp_path))
    assert ended.value.code == 2
    assert "Run `make install`" in capsys.readouterr().err


def test_an_installed_package_has_all_files() -> None:
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    patterns = packages["service.console"]
    for file in [*sources().values(), STATIC / "index.html"]:
        name = file.relative_to(FOLDER).as_posix()
        assert any(fnmatch(name, pattern) and name.count("/") == pattern.count("/") for pattern in patterns), name
