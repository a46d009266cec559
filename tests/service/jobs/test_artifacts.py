import hashlib
import io
import os
import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.artifacts import ArtifactStore, StoreUnavailableError

NOTHING = hashlib.sha256(b"nothing like it").hexdigest()


def put(store: ArtifactStore, content: bytes) -> str:
    with store.stage(io.BytesIO(content), limit=len(content), name="file") as staged:
        store.put(staged)
    return staged.sha256


def read(store: ArtifactStore, sha256: str, start: int, stop: int) -> bytes:
    return b"".join(store.read(sha256, start, stop))


def names(store: ArtifactStore) -> list[str]:
    return sorted(item.sha256 for item in store.listing())


def local_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "reserve")


@pytest.mark.parametrize("content", [b"", b"1", bytes(range(256)) * 100, b"x" * (20 * 2**20 + 1)], ids=len)
def test_content_is_found_under_its_hash(store: ArtifactStore, content: bytes, tmp_path: Path) -> None:
    sha256 = put(store, content)
    assert sha256 == hashlib.sha256(content).hexdigest()
    assert store.has(sha256)
    assert names(store) == [sha256]
    assert read(store, sha256, 0, len(content)) == content
    store.fetch(sha256, len(content), tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == content


def test_any_part_can_be_read(store: ArtifactStore) -> None:
    content = os.urandom(17 * 2**20)  # more than is asked of a server at a time
    sha256, size = put(store, content), len(content)
    for start, stop in [(0, 1), (5, 5), (size - 1, size), (8 * 2**20 - 1, 16 * 2**20 + 1)]:
        assert read(store, sha256, start, stop) == content[start:stop]


def test_what_is_not_there_is_not_found(store: ArtifactStore, tmp_path: Path) -> None:
    assert not store.has(NOTHING)
    for stop in (0, 1, 2**24):
        with pytest.raises(FileNotFoundError):
            read(store, NOTHING, 0, stop)
    with pytest.raises(FileNotFoundError):
        store.fetch(NOTHING, 3, tmp_path / "copy")


def test_the_same_content_is_kept_once_however_often_it_comes(store: ArtifactStore) -> None:
    with ThreadPoolExecutor(8) as pool:
        hashes = set(pool.map(lambda _: put(store, b"x" * 10_000), range(32)))
    [sha256] = hashes
    assert names(store) == [sha256]
    assert read(store, sha256, 0, 10_000) == b"x" * 10_000


def test_content_over_the_limit_is_refused_and_leaves_nothing(store: ArtifactStore, tmp_path: Path) -> None:
    with pytest.raises(MeshmarkError) as caught, store.stage(io.BytesIO(b"12345"), limit=4, name="file"):
        pytest.fail("it was staged")
    assert caught.value.code == ServiceErrorCode.UPLOAD_TOO_LARGE
    assert local_files(tmp_path) == []


def test_reading_an_upload_stops_at_the_limit(store: ArtifactStore) -> None:
    class Endless(io.RawIOBase):
        given = 0

        def read(self, size: int = -1) -> bytes:
            self.given += size
            return b"\0" * size

    stream = Endless()
    with pytest.raises(MeshmarkError), store.stage(stream, limit=3 * 2**20, name="file"):  # type: ignore[arg-type]
        pytest.fail("it was staged")
    assert stream.given <= 4 * 2**20


def test_what_is_staged_is_removed_from_the_local_disk(store: ArtifactStore, tmp_path: Path) -> None:
    with store.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        assert local_files(tmp_path) == [staged.path]
    assert local_files(tmp_path) == []
    assert names(store) == []


def test_what_a_killed_process_left_staged_is_removed_when_it_is_old(store: ArtifactStore, tmp_path: Path) -> None:
    with store.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        store.clear_staging(60)
        assert local_files(tmp_path) == [staged.path]
        os.utime(staged.path, (0, time.time() - 61))
        store.clear_staging(60)
        assert local_files(tmp_path) == []


def test_removing_twice_is_as_good_as_once(store: ArtifactStore) -> None:
    sha256 = put(store, b"1")
    for _ in range(2):
        store.remove(sha256)
        assert not store.has(sha256)
    assert names(store) == []


def test_content_is_listed_by_the_beginning_of_its_hash_with_its_age(store: ArtifactStore) -> None:
    hashes = [put(store, bytes([number])) for number in range(20)]
    assert names(store) == sorted(hashes)
    prefix = hashes[0][:2]
    listed = list(store.listing(prefix))
    assert {item.sha256 for item in listed} == {sha256 for sha256 in hashes if sha256.startswith(prefix)}
    assert datetime.now(UTC) - listed[0].since < timedelta(minutes=1)


def test_damaged_content_is_noticed(store: ArtifactStore, tmp_path: Path) -> None:
    sha256 = put(store, b"whole")
    with pytest.raises(ValueError, match="damaged"):
        store.fetch(sha256, 4, tmp_path / "copy")


def test_a_full_disk_is_a_store_that_is_not_available(store: ArtifactStore, tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, limits[1]))  # a write beyond it fails as on a full disk
    try:
        with pytest.raises(StoreUnavailableError), store.stage(io.BytesIO(bytes(2**22)), limit=2**22, name="file"):
            pytest.fail("it was staged")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert local_files(tmp_path) == []


def test_what_is_still_in_a_buffer_when_the_disk_is_full_changes_nothing(tmp_path: Path) -> None:
    """By a limit on the size of files, which a write meets as it meets the end of a disk."""
    script = (
        "import io, resource, signal, sys; from pathlib import Path\n"
        "from service.jobs.artifacts import StoreUnavailableError; from service.jobs.folder_store import FolderStore\n"
        "store = FolderStore(Path(sys.argv[1]))\n"
        "with store.stage(io.BytesIO(b'x' * 5000), limit=9999, name='file') as staged: store.put(staged)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "for attempt in (\n"
        "    lambda: store.stage(io.BytesIO(b'y' * 5000), limit=9999, name='file').__enter__(),\n"
        "    lambda: store.fetch(staged.sha256, 5000, Path(sys.argv[1], 'fetched')),\n"
        "):\n"
        "    try: attempt(); sys.exit('it was written')\n"
        "    except StoreUnavailableError: pass\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert not list(tmp_path.glob(".staged-*"))
