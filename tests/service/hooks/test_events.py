"""Notifications as their senders document them."""

import base64
import json
from typing import Any

import pytest
from starlette.datastructures import Headers

from core.errors import MeshmarkError
from service.hooks.events import Event, parse_notification

CHAIR = Event(True, "assets", "incoming/my chair+é.glb", "0a1b")


def record(name: str = "s3:ObjectCreated:Put", **item: Any) -> dict[str, Any]:
    return {
        "eventVersion": "2.0",
        "eventSource": "minio:s3",
        "eventTime": "2026-01-31T12:00:00.000Z",
        "eventName": name,
        "s3": {
            "bucket": {"name": "assets", "arn": "arn:aws:s3:::assets"},
            "object": {"key": "incoming/my+chair%2B%C3%A9.glb", "size": 5, "eTag": "0a1b", "sequencer": "17A", **item},
        },
    }


DETAIL = {
    "version": "0",
    "bucket": {"name": "assets"},
    "object": {"key": "incoming/my chair+é.glb", "size": 5, "etag": "0a1b", "sequencer": "617f"},
    "reason": "PutObject",
}
EVENT_BRIDGE = {"version": "0", "id": "1779", "detail-type": "Object Created", "source": "aws.s3", "detail": DETAIL}


def s3(content: Any) -> list[Event]:
    return parse_notification("s3", Headers({"Content-Type": "application/json"}), json.dumps(content).encode())


def test_what_minio_sends() -> None:
    body = {"EventName": "s3:ObjectCreated:Put", "Key": "assets/incoming/chair.glb", "Records": [record()]}
    assert s3(body) == [CHAIR]


def test_what_amazon_s3_sends() -> None:
    several = [record("ObjectCreated:CompleteMultipartUpload"), record("ObjectRemoved:Delete")]
    assert [event.created for event in s3({"Records": several})] == [True, False]


def test_what_event_bridge_sends() -> None:
    assert s3(EVENT_BRIDGE) == [CHAIR]
    assert s3(EVENT_BRIDGE | {"detail-type": "Object Deleted"}) == [CHAIR._replace(created=False)]


def test_a_test_message_tells_nothing() -> None:
    assert s3({"Service": "Amazon S3", "Event": "s3:TestEvent", "Bucket": "assets"}) == []


def test_a_version_is_told_from_another_one_by_the_best_there_is() -> None:
    def version(**item: Any) -> str:
        return s3({"Records": [record(**item)]})[0].version

    assert version(versionId="v7") == "v7"
    assert version(versionId="null") == "0a1b"
    assert version(eTag="") == "17A"
    assert version(eTag=None, sequencer=None) == "2026-01-31T12:00:00.000Z"


GOOGLE = {"bucket": "assets", "name": "incoming/my chair+é.glb", "generation": 1587627537231057, "etag": "CJ"}
ATTRIBUTES = {"specversion": "1.0", "id": "42", "source": "//storage", "type": "com.amazonaws.s3.ObjectCreated:Put"}


def cloud(media_type: str, content: Any, **headers: str) -> list[Event]:
    fields = {"Content-Type": media_type} | {name.replace("_", "-"): value for name, value in headers.items()}
    return parse_notification("cloudevents", Headers(fields), json.dumps(content).encode())


@pytest.mark.parametrize("data", [record(), {"Records": [record()]}, EVENT_BRIDGE, DETAIL])
def test_a_cloud_event_wraps_any_of_them_in_every_mode(data: dict[str, Any]) -> None:
    event = {**ATTRIBUTES, "data": data}
    encoded = {**ATTRIBUTES, "data_base64": base64.b64encode(json.dumps(data).encode()).decode()}
    binary = {f"ce_{name}": value for name, value in ATTRIBUTES.items()}
    assert cloud("application/json", data, **binary) == [CHAIR]
    assert cloud("application/cloudevents+json; charset=utf-8", event) == [CHAIR]
    assert cloud("application/cloudevents+json", encoded) == [CHAIR]
    assert cloud("application/cloudevents-batch+json", [event, event]) == [CHAIR, CHAIR]


def test_what_google_sends() -> None:
    finalized = {**ATTRIBUTES, "type": "google.cloud.storage.object.v1.finalized", "data": GOOGLE}
    assert cloud("application/cloudevents+json", finalized) == [CHAIR._replace(version="1587627537231057")]
    deleted = finalized | {"type": "google.cloud.storage.object.v1.deleted"}
    assert not cloud("application/cloudevents+json", deleted)[0].created


def test_data_without_any_version_is_known_by_the_events_id() -> None:
    plain = {**ATTRIBUTES, "data": {"bucket": "assets", "key": "incoming/my chair+é.glb"}}
    assert cloud("application/cloudevents+json", plain) == [CHAIR._replace(version="42")]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"1",
        b"null",
        b'"text"',
        b"{}",
        b'{"Records": 1}',
        b'{"Records": [1]}',
        b'{"Records": [{"eventName": "ObjectCreated:Put"}]}',
        json.dumps({"Records": [record(key=7)]}).encode(),
        json.dumps({"Records": [record(key="%ff")]}).encode(),
        json.dumps({"Records": [record(key="half a character: \ud83e")]}).encode(),
        b'{"detail": {"bucket": {"name": 1}, "object": {"key": []}}}',
        b"[" * 100_000,
        b"\xff\xfe",
    ],
)
@pytest.mark.parametrize("kind", ["s3", "cloudevents"])
def test_what_is_no_notification_is_refused(kind: str, body: bytes) -> None:
    for media_type in ("application/json", "application/cloudevents+json", "application/cloudevents-batch+json"):
        if kind == "cloudevents" and media_type.endswith("batch+json") and body == b"[]":
            continue  # a batch of nothing
        with pytest.raises(MeshmarkError, match="invalid_request"):
            parse_notification(kind, Headers({"Content-Type": media_type}), body)


def test_another_version_of_cloud_events_is_refused() -> None:
    with pytest.raises(MeshmarkError, match="invalid_request"):
        cloud("application/cloudevents+json", {**ATTRIBUTES, "specversion": "0.3", "data": DETAIL})
