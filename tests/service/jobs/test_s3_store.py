"""Faults that only a bucket can have; those of every store are in test_artifacts.py."""

import io
from pathlib import Path

import obstore
import pytest
from structlog.testing import capture_logs

from service.jobs.artifacts import ArtifactStore, StoreUnavailableError
from service.jobs.stores import open_store
from tests.service.harness import free_port
from tests.service.s3 import S3, Bucket, bucket_settings

SHA256 = "ab" * 32


def put(store: ArtifactStore) -> None:
    with store.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        store.put(staged)


def test_a_bucket_that_does_not_exist_is_a_store_that_is_not_available(s3: S3, tmp_path: Path) -> None:
    store = open_store(bucket_settings(Bucket(s3.url, "no-such-bucket"), tmp_path))
    with pytest.raises(StoreUnavailableError):
        put(store)
    with pytest.raises(StoreUnavailableError):
        list(store.listing())


def test_a_server_that_is_not_there_is_a_store_that_is_not_available(tmp_path: Path) -> None:
    store = open_store(bucket_settings(Bucket(f"http://127.0.0.1:{free_port()}", "bucket"), tmp_path))
    for use in (
        lambda: put(store),
        lambda: store.has(SHA256),
        lambda: list(store.read(SHA256, 0, 1)),
        lambda: store.remove(SHA256),
        lambda: list(store.listing()),
    ):
        with capture_logs() as logged, pytest.raises(StoreUnavailableError):
            use()
        [line] = logged
        assert "127.0.0.1" in line["error"]
        assert len(line["error"].splitlines()) == 1
        assert "Debug source" not in line["error"]


def test_several_services_may_share_a_bucket_under_prefixes_of_their_own(s3: S3, tmp_path: Path) -> None:
    bucket = s3.new_bucket()
    one, other = (
        open_store(bucket_settings(bucket, tmp_path).model_copy(update={"store_url": f"s3://{bucket.name}{prefix}"}))
        for prefix in ("", "/other/")
    )
    put(one)
    [stored] = one.listing()
    assert list(other.listing()) == []
    assert not other.has(stored.sha256)
    put(other)
    assert len(list(one.listing())) == 1
    one.remove(stored.sha256)
    assert other.has(stored.sha256)


def test_what_others_keep_in_the_bucket_is_not_listed(s3: S3, tmp_path: Path) -> None:
    bucket = s3.new_bucket()
    store = open_store(bucket_settings(bucket, tmp_path))
    for name in ("ab/notes.txt", f"cd/{SHA256}", f"deep/ab/{SHA256}"):
        obstore.put(bucket.open(), f"some/prefix/{name}", b"theirs")
    assert list(store.listing()) == list(store.listing("ab")) == []
