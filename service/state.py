"""What the routes share."""

from dataclasses import dataclass
from typing import Annotated

from celery import Celery
from fastapi import Depends, Request

from service.config import Settings
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Ledger


@dataclass(frozen=True)
class AppState:
    """One app's settings and connections."""

    settings: Settings
    ledger: Ledger
    artifacts: ArtifactStore
    queue: Celery


async def _state(request: Request) -> AppState:
    state = request.app.state.meshmark
    assert isinstance(state, AppState)
    return state


State = Annotated[AppState, Depends(_state)]
