import hashlib
import io
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from service.jobs.artifacts import ArtifactStore


def put(store: ArtifactStore, content: bytes) -> Path:
    with store.stage(io.BytesIO(content), limit=len(content), name="file") as staged, store.exclusive():
        store.add(staged)
    return store.path(staged.sha256)


def files(store: ArtifactStore) -> list[Path]:
    return sorted(path for path in store.root.rglob("*") if path.is_file() and path.name != ".lock")


@given(content=st.binary(max_size=200))
def test_content_is_found_under_its_hash(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    store = ArtifactStore(tmp_path_factory.mktemp("store"))
    digest = hashlib.sha256(content).hexdigest()
    path = put(store, content)
    assert path == store.root / digest[:2] / digest
    assert path.read_bytes() == content
    assert files(store) == [path]


def test_the_same_content_is_kept_once_however_often_it_comes(tmp_path: Path) -> None:
    store = ArtifactStore(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        paths = set(pool.map(lambda _: put(store, b"x" * 10_000), range(32)))
    assert files(store) == list(paths)
    assert files(store)[0].read_bytes() == b"x" * 10_000


def test_content_over_the_limit_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    store = ArtifactStore(tmp_path)
    with pytest.raises(MeshmarkError) as caught, store.stage(io.BytesIO(b"12345"), limit=4, name="file"):
        pytest.fail("it was staged")
    assert caught.value.code == ErrorCode.UPLOAD_TOO_LARGE
    assert files(store) == []


def test_reading_stops_at_the_limit(tmp_path: Path) -> None:
    class Endless(io.RawIOBase):
        given = 0

        def read(self, size: int = -1) -> bytes:
            self.given += size
            return b"\0" * size

    stream = Endless()
    with (
        pytest.raises(MeshmarkError),
        ArtifactStore(tmp_path).stage(stream, limit=3 * 2**20, name="file"),  # type: ignore[arg-type]
    ):
        pytest.fail("it was staged")
    assert stream.given <= 4 * 2**20


def test_staged_content_that_is_not_added_is_removed(tmp_path: Path) -> None:
    store = ArtifactStore(tmp_path)
    with store.stage(io.BytesIO(b"1"), limit=1, name="file"):
        assert len(files(store)) == 1
    assert files(store) == []


def test_removing_twice_is_as_good_as_once(tmp_path: Path) -> None:
    store = ArtifactStore(tmp_path)
    digest = put(store, b"1").name
    for _ in range(2):
        store.remove(digest)
    assert files(store) == []
