"""Shared state of the routes."""

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

from celery import Celery
from fastapi import Depends, Request

from service.address_limit import PublicLimits
from service.announcer import Announcer
from service.config import Settings
from service.event_stream import Streams
from service.in_flight import InFlight
from service.intake import Intake
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Ledger
from service.readiness import Readiness
from service.store_threads import CONTENT, DELETIONS, StoreThreads
from service.webhooks.vault import Vault


@dataclass(frozen=True)
class AppState:
    """Settings, connections and concurrency limits of one application."""

    settings: Settings
    ledger: Ledger
    artifacts: ArtifactStore
    queue: Celery
    announcer: Announcer
    readiness: Readiness
    vault: Vault
    intake: Intake
    public: PublicLimits
    streams: Streams = field(default_factory=Streams)
    uploads: InFlight = field(default_factory=InFlight)
    content: StoreThreads = field(default_factory=partial(StoreThreads, CONTENT))
    deletions: StoreThreads = field(default_factory=partial(StoreThreads, DELETIONS))


def state_of(request: Request) -> AppState:
    """State of the application that a request came to."""
    state = request.app.state.meshmark
    assert isinstance(state, AppState)
    return state


async def _state(request: Request) -> AppState:
    return state_of(request)


State = Annotated[AppState, Depends(_state)]
