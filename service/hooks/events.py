"""Notifications about objects that were created in a bucket.

Three shapes are read: the `Records` of Amazon S3 and MinIO, whose keys are URL-encoded; Amazon EventBridge's `detail`,
whose keys are not; and a plain object with `bucket` and `key` or `name`, as Google's and other CloudEvents have it. A
CloudEvent (1.0, in binary, structured or batched mode) wraps one of them as its data.
"""

import base64
import json
import re
from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import unquote_plus

from core.errors import ErrorCode, MeshmarkError

CREATED = re.compile(r"object[ ._:-]?created|\.finalized$", re.IGNORECASE)


class Event(NamedTuple):
    """Event about an object; `version` identifies this version of its content."""

    created: bool
    bucket: str
    key: str
    version: str


def parse_notification(kind: str, headers: Mapping[str, str], body: bytes) -> list[Event]:
    """Events in a request body; none, where it is a test message.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    try:
        content = json.loads(body)
        if kind == "s3":
            return _events(content, "", "")
        return [event for envelope in _envelopes(headers, content) for event in _unwrapped(envelope)]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "The body is no notification about objects in a bucket.",
            "Send what S3, MinIO or EventBridge send, or CloudEvents with the like as data, as the hook is configured.",
        ) from None


def _envelopes(headers: Mapping[str, str], content: Any) -> list[dict[str, Any]]:
    """CloudEvents in the structured form, whichever mode they came in (CloudEvents HTTP binding 1.0, section 3)."""
    media_type = headers.get("Content-Type", "").partition(";")[0].strip().lower()
    if media_type == "application/cloudevents-batch+json":
        if not isinstance(content, list):
            raise TypeError("a batch is a list")
        return content
    if media_type == "application/cloudevents+json":
        return [content]
    named = {name.removeprefix("ce-"): value for name, value in headers.items() if name.startswith("ce-")}
    return [{**named, "data": content}]


def _unwrapped(envelope: dict[str, Any]) -> list[Event]:
    if envelope["specversion"] != "1.0":
        raise ValueError("another version of CloudEvents")
    data = envelope["data"] if "data" in envelope else json.loads(base64.b64decode(envelope["data_base64"]))
    return _events(data, str(envelope["type"]), str(envelope["id"]))


def _events(content: dict[str, Any], happened: str, identity: str) -> list[Event]:
    """The events in data of any shape; `happened` and `identity` are those of its envelope, if it has one."""
    if "Records" in content:
        return [_record(record) for record in content["Records"]]
    if "s3" in content:
        return [_record(content)]
    if "detail" in content:
        detail, happened = content["detail"], str(content.get("detail-type", happened))
        item, bucket = detail["object"], detail["bucket"]["name"]
        return [_event(happened, bucket, item["key"], item, str(content.get("id", identity)))]
    if "object" in content:  # EventBridge's detail by itself
        return [_event(happened, content["bucket"]["name"], content["object"]["key"], content["object"], identity)]
    if "bucket" in content:
        key = content["key"] if "key" in content else content["name"]
        return [_event(str(content.get("eventName", happened)), content["bucket"], key, content, identity)]
    if "Event" in content:  # s3:TestEvent
        return []
    raise ValueError("nothing that is known")


def _record(record: dict[str, Any]) -> Event:
    entity = record["s3"]
    key = unquote_plus(entity["object"]["key"], errors="strict")
    happened, when = str(record["eventName"]), str(record.get("eventTime", ""))
    return _event(happened, entity["bucket"]["name"], key, entity["object"], when)


def _event(happened: str, bucket: Any, key: Any, item: dict[str, Any], identity: str) -> Event:
    if not isinstance(bucket, str) or not isinstance(key, str):
        raise TypeError("names are text")
    (bucket + key).encode()  # JSON can say halves of characters, which are none
    names = ("versionId", "version-id", "generation", "eTag", "etag", "sequencer")
    version = next((str(item[name]) for name in names if item.get(name) not in (None, "", "null")), identity)
    return Event(bool(CREATED.search(happened)), bucket, key, version)
