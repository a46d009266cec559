"""Problems, of requests and of jobs, as exceptions (RFC 9457)."""

from collections.abc import Mapping
from typing import Any

import httpx2


class MeshmarkProblem(Exception):  # noqa: N818  # the service's own word for it
    """Refusal of a request, failure of a job, or a service that does not answer.

    Attributes:
        code: stable, to program against: one of the manual's page on errors, or of this client ``unreachable`` (no
            answer came) and ``unexpected_answer`` (it is none of the service's, as of a proxy).
        detail: what is wrong with this request or this file.
        remedy: what to do about it.
        status: HTTP status; None where there was no answer, and for the failure of a job.
        job_id: id of the job that has no results; None for a request.
    """

    def __init__(
        self, code: str, detail: str, remedy: str, status: int | None = None, job_id: str | None = None
    ) -> None:
        super().__init__(f"{code}: {detail} {remedy}".rstrip())
        self.code, self.detail, self.remedy, self.status, self.job_id = code, detail, remedy, status, job_id


def problem_of(response: httpx2.Response) -> MeshmarkProblem:
    """The problem that a response tells of; its body has been read."""
    try:
        return told(response.json(), response.status_code)
    except (ValueError, KeyError, TypeError):
        return MeshmarkProblem(
            "unexpected_answer",
            f"{response.request.method} {response.request.url} was answered with {response.status_code}, not as "
            "the service does.",
            "See whether the address is that of the service, and what stands between.",
            response.status_code,
        )


def failure_of(facts: Mapping[str, Any]) -> MeshmarkProblem | None:
    """Why a job has no results; None where it has some, or has not ended."""
    match facts["state"]:
        case "failed":
            problem = told(facts["error"], None)
        case "canceled":
            problem = MeshmarkProblem("job_canceled", "The job was canceled.", "Send the asset again.")
        case "expired":
            problem = MeshmarkProblem("job_expired", "The files of the job were deleted.", "Send the asset again.")
        case _:
            return None
    problem.job_id = str(facts["id"])
    return problem


def unreachable(request: httpx2.Request, error: httpx2.TransportError) -> MeshmarkProblem:
    """The problem of a request to which no whole answer came."""
    return MeshmarkProblem(
        "unreachable",
        f"{request.method} {request.url} was not answered: {str(error) or type(error).__name__}.",
        "See whether the service runs and can be reached.",
    )


def told(problem: Mapping[str, Any], status: int | None) -> MeshmarkProblem:
    """The problem that the service tells of in these members.

    Raises:
        KeyError: one is missing.
    """
    return MeshmarkProblem(str(problem["code"]), str(problem["detail"]), str(problem["remedy"]), status)
