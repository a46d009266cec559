"""Routes of liveness and readiness probes."""

from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.problems import problem_responses
from service.state import State

# Anybody may ask: no key is needed.
router = APIRouter(tags=["health"])
OPEN: dict[str, Any] = {"security": []}


class Health(BaseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"


class Ready(BaseModel):
    """Ledger, broker and artifact store answer."""

    status: Literal["ready"] = "ready"


@router.get("/healthz", summary="Check that the process serves", openapi_extra=OPEN)
async def health() -> Health:
    """Answer 200 as long as the process serves; for what starts it again when it does not."""
    return Health()


@router.get(
    "/readyz",
    summary="Check that the service is ready",
    responses=problem_responses(ServiceErrorCode.SERVICE_UNAVAILABLE),
    openapi_extra=OPEN,
)
async def ready(state: State) -> Ready:
    """Answer 200 while ledger, broker and artifact store answer; for what sends requests here or elsewhere."""
    if failing := await state.readiness.failing():
        raise MeshmarkError(
            ServiceErrorCode.SERVICE_UNAVAILABLE,
            f"The service is not ready. What does not answer: {', '.join(failing)}.",
            "Try again later; the operator can look at the log.",
        )
    return Ready()
