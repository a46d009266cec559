"""Routes whose bodies are JSON."""

from collections.abc import Callable, Coroutine
from http import HTTPStatus
from typing import Any

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

from core.errors import ErrorCode, MeshmarkError
from service.access import GuardedRoute
from service.problems import upload_too_large

MAX_BODY_BYTES = 2**16


class JsonRoute(GuardedRoute):
    """A guarded route that says what is wrong with a JSON body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """What answers a request."""
        answer = super().get_route_handler()

        async def explaining(request: Request) -> Response:
            try:
                return await answer(request)
            except RequestValidationError as error:
                problems = [(item["loc"], item["msg"]) for item in error.errors() if item["loc"][0] == "body"]
                if not problems:  # it is something else in the request
                    raise
                listed = "; ".join(f"{'.'.join(map(str, place[1:])) or 'body'}: {text}" for place, text in problems)
                raise MeshmarkError(
                    ErrorCode.INVALID_REQUEST,
                    f"The body is not what is expected here: {listed}.",
                    "Send a JSON object as application/json; /docs tells what it may hold.",
                ) from None
            except HTTPException as error:
                if error.status_code != HTTPStatus.REQUEST_ENTITY_TOO_LARGE:
                    raise
                raise upload_too_large(MAX_BODY_BYTES) from None

        return explaining
