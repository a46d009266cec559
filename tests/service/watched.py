"""A watched bucket of a real S3 server, and a service that is told of what is dropped in it."""

import json
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote_plus

import obstore
from httpx2 import Response
from obstore.store import S3Store
from sqlalchemy import select, update

from service.jobs.clock import now
from service.jobs.models import DroppedObject
from tests.service.conftest import Client
from tests.service.s3 import KEYS, Bucket

TOKEN = "0123456789abcdef"


@dataclass
class Watched:
    """A bucket with a hook, and how MinIO would tell of it."""

    bucket: Bucket
    url: str  # of the server itself, also where the hook reaches it by another way
    versions: dict[str, str] = field(default_factory=dict)

    def drop(self, key: str, content: bytes) -> None:
        self.versions[key] = (obstore.put(self.store, key, content)["e_tag"] or "").strip('"')

    @property
    def store(self) -> S3Store:
        return Bucket(self.url, self.bucket.name).open()

    def read(self, key: str) -> bytes | None:
        try:
            return bytes(obstore.get(self.store, key).bytes())
        except FileNotFoundError:
            return None

    def notification(self, *keys: str, name: str = "s3:ObjectCreated:Put") -> dict[str, Any]:
        return {"EventName": name, "Records": [self.record(key, name) for key in keys]}

    def record(self, key: str, name: str) -> dict[str, Any]:
        entity = {"key": quote_plus(key), "eTag": self.versions.get(key, "0")}
        return {"eventName": name, "s3": {"bucket": {"name": self.bucket.name}, "object": entity}}

    def hooks_file(self, folder: Path, **more: str) -> Path:
        values = {
            "kind": "s3",
            "token": TOKEN,
            "bucket": self.bucket.name,
            "endpoint": self.bucket.endpoint,
            "access_key_id": KEYS["s3_access_key_id"],
            "secret_access_key": KEYS["s3_secret_access_key"],
            "input_prefix": "incoming/",
            "output_prefix": "watermarked/",
        } | more
        path = folder / "hooks.toml"
        lines = [f"{name} = {json.dumps(value)}" for name, value in values.items()]
        wishes = 'parameters = { text = "HI", format = "ply", preview_model = {} }'
        path.write_text("\n".join(["[sources.shop]", *lines, wishes, ""]))
        return path


def tell(client: Client, content: Any, source: str = "shop", token: str = TOKEN) -> Response:
    headers = {"Authorization": f"Bearer {token}"}
    return client.http.post(f"/v1/hooks/{source}", json=content, headers=headers)


def accepted(client: Client, content: Any) -> list[str]:
    """The jobs of a notification in which nothing is ignored."""
    answer = tell(client, content)
    assert answer.status_code == 202, answer.text
    assert answer.json()["ignored"] == []
    return [item["job"] for item in answer.json()["jobs"]]


def run(client: Client, job_id: str) -> dict[str, Any]:
    client.run(f"/v1/watermarks/{job_id}")
    return dict(client.http.get(f"/v1/watermarks/{job_id}").json())


def outputs(client: Client) -> list[str]:
    with client.worker.ledger.sessions() as session:
        return list(session.scalars(select(DroppedObject.output).order_by(DroppedObject.created_at)))


def make_due(client: Client) -> None:
    with client.worker.ledger.sessions.begin() as session:
        session.execute(update(DroppedObject).values(due_at=now() - timedelta(seconds=1)))
