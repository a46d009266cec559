import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from core.notices import NoticeCode
from core.report import Report
from core.verify.report import VerificationReport
from service.__main__ import openapi
from service.routes.report_example import REPORT
from service.routes.verification_example import VERIFICATION

COMMITTED = Path(__file__).parents[2] / "openapi.yaml"


def test_the_committed_openapi_document_is_that_of_the_application() -> None:
    assert COMMITTED.read_text() == openapi(), "run: python -m service openapi > openapi.yaml"


def test_every_error_in_the_openapi_document_is_a_problem() -> None:
    document = yaml.safe_load(openapi())
    responses = [
        (status, response)
        for path in document["paths"].values()
        for method, operation in path.items()
        if method != "head"  # whose answers have no content
        for status, response in operation["responses"].items()
    ]
    errors = [response for status, response in responses if int(status) >= 400]
    assert errors
    for response in errors:
        assert list(response["content"]) == ["application/problem+json"]
    assert "HTTPValidationError" not in str(document)
    for schema in ("Problem", "Parameters", "JobView", "ErrorCode"):
        assert schema in document["components"]["schemas"]


def test_the_openapi_document_describes_the_report_field_by_field() -> None:
    document = yaml.safe_load(openapi())
    answers = document["paths"]["/v1/watermarks/{job_id}/report"]["get"]["responses"]
    assert {answers[code]["content"]["application/json"]["schema"]["$ref"] for code in ("200", "206")} == {
        "#/components/schemas/Report"
    }
    schemas = document["components"]["schemas"]
    assert list(schemas["Report"]["properties"]) == schemas["Report"]["required"]
    assert [Report.model_validate(example).model_dump(mode="json") for example in schemas["Report"]["examples"]] == [
        REPORT
    ]
    [seen] = schemas["VerificationReport"]["examples"]
    assert VerificationReport.model_validate(seen).model_dump(mode="json") == VERIFICATION
    assert schemas["NoticeCode"]["enum"] == [*NoticeCode]
    assert schemas["Watermark"]["properties"]["relief"]["description"] == "Height of its letters, world units."


@pytest.mark.parametrize("module", ["service.__main__", "worker.app", "worker.webhooks", "worker.signer"])
def test_neither_api_nor_worker_loads_the_engines_heavy_libraries(module: str) -> None:
    heavy = [
        "torch",
        "igl",
        "embreex",
        "manifold3d",
        "scipy",
        "trimesh",
        "collada",
        "onnxruntime",
        "OpenGL",
        "pyrender",
    ]
    heavy += ["DracoPy", "meshopt"]
    script = f"import sys, {module}\nprint(*[name for name in {heavy} if name in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == []
