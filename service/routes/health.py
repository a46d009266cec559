"""Whether the service can do its work."""

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel

from core.errors import ErrorCode
from service.problems import problem_responses
from service.state import State

router = APIRouter(tags=["health"])


class Health(BaseModel):
    """The service is up and reaches its ledger."""

    status: Literal["ok"] = "ok"


@router.get("/healthz", responses=problem_responses(ErrorCode.SERVICE_UNAVAILABLE))
def health(state: State) -> Health:
    """Answer 200 while the ledger can be reached."""
    state.ledger.ping()
    return Health()
