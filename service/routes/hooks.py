"""Upload hooks: a file dropped in a watched bucket becomes a job."""

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import IntegrityError
from starlette.requests import ClientDisconnect

from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from service.hooks.config import HookSource
from service.hooks.events import Event, parse_notification
from service.hooks.guard import check_signature, check_token
from service.hooks.handshake import grant
from service.jobs import dropped
from service.problems import problem_responses
from service.state import AppState, State
from service.submission import Order, plain_name, submit

LONGEST_KEY = 1024  # bytes: the limit of S3

# Not a guarded route: senders of notifications have a token of their own, see service.hooks.guard.
router = APIRouter(prefix="/v1/hooks", tags=["hooks"])

REFUSALS = problem_responses(
    ServiceErrorCode.INVALID_HOOK_TOKEN,
    ServiceErrorCode.NOT_FOUND,
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ServiceErrorCode.TOO_MANY_JOBS,
    ServiceErrorCode.QUOTA_EXCEEDED,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)
HOOK_SCHEME = "hook_token"  # its name in the OpenAPI document
BODY: dict[str, Any] = {
    "security": [{}, {HOOK_SCHEME: []}],
    "requestBody": {
        "description": "What Amazon S3, MinIO or EventBridge send about objects, or CloudEvents 1.0 with the like.",
        "required": True,
        "content": {
            media_type: {"schema": {}}
            for media_type in ("application/json", "application/cloudevents+json", "application/cloudevents-batch+json")
        },
    },
}
HANDSHAKE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The sender named by `WebHook-Request-Origin` may send, at any rate.",
        "headers": {
            name: {"description": meaning, "schema": {"type": "string"}}
            for name, meaning in {
                "WebHook-Allowed-Origin": "The sender.",
                "WebHook-Allowed-Rate": "`*`: any number of requests a minute.",
                "Allow": "`POST`.",
            }.items()
        },
    }
}


class HookJob(BaseModel):
    """An object that has a job."""

    key: str
    job: Annotated[str, Field(description="The job's id; the same, however often the object is told of.")]


class IgnoredEvent(BaseModel):
    """An event that makes no job."""

    key: str
    reason: str


class HookResult(BaseModel):
    """What was made of a notification."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "jobs": [{"key": "incoming/lantern.glb", "job": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11"}],
                    "ignored": [{"key": "incoming/notes.txt", "reason": "The name has none of the suffixes."}],
                }
            ]
        }
    )

    jobs: list[HookJob]
    ignored: list[IgnoredEvent]


@router.options(
    "/{source}",
    summary="Register a sender of notifications",
    response_class=Response,
    responses=HANDSHAKE | problem_responses(ServiceErrorCode.NOT_FOUND, ServiceErrorCode.METHOD_NOT_ALLOWED),
    openapi_extra={"security": []},
)
async def allow_sender(request: Request, state: State, source: str) -> Response:
    """Let a sender of CloudEvents, of those that the hook is configured with, register for sending notifications."""
    return Response(headers=grant(_hook(state, source), request.headers))


@router.post(
    "/{source}",
    summary="Receive a notification about objects",
    status_code=status.HTTP_202_ACCEPTED,
    responses=REFUSALS,
    openapi_extra=BODY,
)
async def receive_notification(request: Request, background: BackgroundTasks, state: State, source: str) -> HookResult:
    """Hear of objects in a bucket. Those that came under the input prefix are watermarked, once each."""
    hook = _hook(state, source)
    check_token(hook, request.headers)
    try:
        body = await request.body()
    except ClientDisconnect:
        raise MeshmarkError(ErrorCode.INVALID_REQUEST, "The request broke off.", "Send it again.") from None

    def accept() -> HookResult:  # in a thread: a notification may be a megabyte of JSON
        check_signature(hook, request.headers, body)
        return _accept(state, source, hook, parse_notification(hook.kind, request.headers, body), background)

    return await run_in_threadpool(accept)


def _hook(state: AppState, name: str) -> HookSource:
    hook = state.settings.hooks.get(name)
    if hook is None:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND, f"There is no hook {name[:64]!r}.", "Use a name that the hooks file has."
        )
    return hook


def _accept(
    state: AppState, name: str, hook: HookSource, events: list[Event], background: BackgroundTasks
) -> HookResult:
    result = HookResult(jobs=[], ignored=[])
    for event in events:
        if reason := next(_objections(hook, event), None):
            result.ignored.append(IgnoredEvent(key=event.key[:LONGEST_KEY], reason=reason))
        else:
            result.jobs.append(HookJob(key=event.key, job=_job_of(state, name, hook, event, background)))
    return result


def _objections(hook: HookSource, event: Event) -> Iterator[str]:
    """Reasons for which an event makes no job."""
    if not event.created:
        yield "It is not about an object that was created."
    if event.bucket != hook.bucket:
        yield "It is about another bucket."
    if event.key.startswith(hook.output_prefix):
        yield "It is what was written here."
    if not event.key.startswith(hook.input_prefix):
        yield "It is not under the input prefix."
    if not event.key.lower().endswith(hook.suffixes):
        yield "The name has none of the suffixes."
    if not event.key.isprintable() or len(event.key.encode("utf-8", "replace")) > LONGEST_KEY:
        yield "The name cannot be used."


def _job_of(state: AppState, name: str, hook: HookSource, event: Event, background: BackgroundTasks) -> str:
    """Existing job of an object, or a new one."""
    sessions = state.ledger.sessions
    object_id = dropped.identity(name, event.bucket, event.key, event.version)
    if job_id := dropped.job_of(sessions, object_id):
        return job_id
    order = Order(
        hook.tenant,
        plain_name(event.key),
        hook.parameters,
        {"hook": name, "key": event.key[:256]},
        asset=None,
        record=partial(dropped.record, object_id=object_id, source=name, key=event.key),
    )
    try:
        job = submit(state, order).job
    except IntegrityError:  # another process heard of it at the same moment
        job_id = dropped.job_of(sessions, object_id)
        if job_id is None:
            raise
        return job_id
    background.add_task(state.announcer.announce, job)
    return job.id
