"""The API reference: a viewer that is served here and shows this service's own document."""

import re
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from service.problems import install_problem_handlers
from service.routes.reference import OWN, reference_router
from tests.service.conftest import Client


def app(libraries: Path) -> TestClient:
    made = FastAPI(redirect_slashes=False, openapi_url=None)
    made.include_router(reference_router(libraries))
    install_problem_handlers(made, 1)
    return TestClient(made, follow_redirects=False)


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> TestClient:
    libraries = tmp_path_factory.mktemp("libraries")
    (libraries / "swagger-ui-dist").mkdir()
    for name in ("swagger-ui.css", "swagger-ui-bundle.js"):
        (libraries / "swagger-ui-dist" / name).write_text(f"/* {name} */")
    return app(libraries)


def test_the_page_and_all_that_it_loads_are_sent_from_here(http: TestClient) -> None:
    page = http.get("/reference")
    assert page.headers["Content-Type"] == "text/html; charset=utf-8"
    named = re.findall(r'(?:src|href)="(reference/[^"]+)"', page.text)
    assert len(named) >= 5
    for name in named:
        assert http.get(f"/{name}").status_code == 200, name
    assert not re.search(r'(?:src|href)="(?:\w+:|//)', page.text)
    assert not re.search(r"<script>|<style|\sstyle=|\son\w+=", page.text), "the policy forbids them"


def test_its_policy_lets_nothing_run_but_files_of_this_service(http: TestClient) -> None:
    for path in ("/reference", "/reference/start.js"):
        policy = http.get(path).headers["Content-Security-Policy"]
        assert "default-src 'none'; script-src 'self'; style-src 'self';" in policy
        assert "unsafe" not in policy


def test_it_shows_the_services_own_document_and_asks_no_other_host_to_check_it(client: Client) -> None:
    script = (OWN / "start.js").read_text()
    assert 'url: "openapi.json"' in script
    assert "validatorUrl: null" in script
    assert client.http.get("/openapi.json").status_code == 200


@pytest.mark.parametrize("name", ["index.html", "..%2findex.html", "LICENSE"])
def test_nothing_else_is_sent(http: TestClient, name: str) -> None:
    assert http.get(f"/reference/{name}").json()["code"] == "not_found"


def test_where_the_viewer_is_not_installed_the_answer_says_how_to(tmp_path: Path) -> None:
    answer = app(tmp_path).get("/reference")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert "make install" in answer.json()["remedy"]
