"""The engine has its codes, the service has its own, and clients see them as one list."""

import re

import pytest

from core.errors import Code, ErrorCode, MeshmarkError
from service.app import create_app
from service.config import Settings
from service.errors import ServiceErrorCode, error_code
from service.problems import STATUS, problem_of
from tests.manual import ROOT


def source(*packages: str) -> str:
    return "\n".join(path.read_text() for package in packages for path in sorted((ROOT / package).rglob("*.py")))


def raised(kind: type[Code], *packages: str) -> set[str]:
    """The codes of a kind that packages use, other than as a key of a table."""
    return set(re.findall(rf"(?<!\w){kind.__name__}\.([A-Z_]+)\b(?!:)", source(*packages)))


def test_no_code_is_both_the_engines_and_the_services() -> None:
    assert {*map(str, ErrorCode)}.isdisjoint(map(str, ServiceErrorCode))


def test_codes_of_the_service_are_snake_case_and_equal_to_their_names() -> None:
    assert all(code.value == code.name.lower() for code in ServiceErrorCode)


def test_the_engine_raises_each_of_its_codes_and_the_service_or_a_worker_each_of_its_own() -> None:
    assert raised(ErrorCode, "core") == {code.name for code in ErrorCode}
    assert raised(ServiceErrorCode, "service", "worker") == {code.name for code in ServiceErrorCode}


def test_the_engine_names_no_code_of_the_service() -> None:
    assert re.findall(rf"""["'](?:{"|".join(ServiceErrorCode)})["']""", source("core")) == []


@pytest.mark.parametrize("code", [ErrorCode.NO_FACES, ServiceErrorCode.WORKER_LOST])
def test_a_code_that_was_stored_or_sent_is_the_engines_or_the_services(code: Code) -> None:
    assert error_code(code.value) is code
    problem = problem_of(MeshmarkError(code, "It failed.", "Try again."))
    assert problem.code is code
    assert problem.model_dump(mode="json")["code"] == code.value


def test_a_code_that_nobody_has_is_refused() -> None:
    with pytest.raises(ValueError, match="'no_such_code'"):
        error_code("no_such_code")


def test_openapi_lists_the_codes_of_both_as_one_type() -> None:
    schemas = create_app(Settings()).openapi()["components"]["schemas"]
    assert schemas["ErrorCode"]["enum"] == [*STATUS]
    assert {schemas[name]["properties"]["code"]["$ref"] for name in ("Problem", "ErrorView")} == {
        "#/components/schemas/ErrorCode"
    }
