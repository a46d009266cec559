"""Limit on the JSON of a request, checked before it is parsed."""

from typing import Any

from fastapi import Request

from core.errors import ErrorCode, MeshmarkError

MOST_VALUES = 50_000  # in one body


class JsonRequest(Request):
    """Request whose JSON has a limited number of values: while it is parsed, nothing else in the process runs."""

    async def json(self) -> Any:
        """Parse the body.

        Raises:
            MeshmarkError: ``invalid_request``.
        """
        body = await self.body()
        # A value is the first in something that opens, or comes after a comma. Those in texts are counted too.
        if sum(map(body.count, (b",", b"[", b"{"))) > MOST_VALUES:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                f"The body has more than {MOST_VALUES:,} values.",
                "Send less at once.",
            )
        return await super().json()
