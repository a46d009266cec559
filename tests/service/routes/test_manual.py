"""The manual over HTTP."""

from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from service.problems import install_problem_handlers
from service.routes.manual import manual_router
from tests.service.conftest import Client


def app(site: Path) -> TestClient:
    made = FastAPI(redirect_slashes=False, docs_url=None, openapi_url=None)
    made.include_router(manual_router(site))
    install_problem_handlers(made, 1)
    return TestClient(made, follow_redirects=False)


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> TestClient:
    site = tmp_path_factory.mktemp("site")
    (site / "errors" / "no_faces").mkdir(parents=True)
    for name in ("index.html", "llms.txt", "errors.md", "errors/index.html", "errors/no_faces/index.html"):
        (site / name).write_text(f"this is {name}")
    (site.parent / "secret.md").write_text("secret")
    return app(site)


def test_pages_their_markdown_and_llms_txt_are_sent(http: TestClient) -> None:
    kinds = {
        "/docs/": ("index.html", "text/html; charset=utf-8"),
        "/docs/errors/no_faces/": ("errors/no_faces/index.html", "text/html; charset=utf-8"),
        "/docs/errors.md": ("errors.md", "text/markdown; charset=utf-8"),
        "/llms.txt": ("llms.txt", "text/plain; charset=utf-8"),
    }
    for path, (name, kind) in kinds.items():
        answer = http.get(path)
        assert (answer.status_code, answer.text, answer.headers["Content-Type"]) == (200, f"this is {name}", kind)
        head = http.head(path)
        assert (head.content, head.headers["Content-Length"]) == (b"", answer.headers["Content-Length"])


def test_pages_come_with_a_policy_that_lets_them_load_what_is_here_and_run_nothing_that_stands_in_them(
    http: TestClient,
) -> None:
    headers = http.get("/docs/").headers
    policy = dict(part.strip().partition(" ")[::2] for part in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_a_page_that_a_browser_has_is_not_sent_again(http: TestClient) -> None:
    tag = http.get("/docs/").headers["ETag"]
    answer = http.get("/docs/", headers={"If-None-Match": tag})
    assert (answer.status_code, answer.content) == (304, b"")


@pytest.mark.parametrize(
    ("path", "location"), [("/docs", "docs/"), ("/docs/errors", "errors/"), ("/docs/errors/no_faces", "no_faces/")]
)
def test_an_address_without_its_last_slash_leads_on_by_a_relative_one(
    http: TestClient, path: str, location: str
) -> None:
    answer = http.get(path, headers={"Host": "evil.example"})
    assert (answer.status_code, answer.headers["Location"]) == (308, location)


@pytest.mark.parametrize("path", ["../secret.md", "%2e%2e/secret.md", "..%2fsecret.md", "/etc/passwd", "errors//", "x"])
def test_nothing_else_is_sent(http: TestClient, path: str) -> None:
    answer = http.get(f"/docs/{path}")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


def test_where_the_manual_is_not_built_the_answer_says_how_to(tmp_path: Path) -> None:
    http = app(tmp_path / "missing")
    for path in ("/docs/", "/docs/errors/no_faces", "/llms.txt"):
        answer = http.get(path)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
        assert "make install" in answer.json()["remedy"]


def test_the_frameworks_own_pages_that_load_their_script_from_another_host_are_gone(client: Client) -> None:
    assert client.http.get("/redoc").status_code == 404
    assert client.http.get("/docs").headers["Location"] == "docs/"
    assert client.http.get("/openapi.json").status_code == 200
