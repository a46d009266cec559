import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from core.budgets import DEFAULT_BUDGETS
from core.errors import MeshmarkError
from tests.worker.engines import asset
from worker.runner import Limits, Work, run_engine
from worker.sandbox import probe
from worker.template import Template


def test_the_engine_reaches_neither_network_nor_files_nor_its_worker(template: Template, tmp_path: Path) -> None:
    """Each attempt would succeed outside of the sandbox."""
    scratch, private, outside = tmp_path / "data" / "scratch", tmp_path / "data" / "ledger", tmp_path / "outside"
    scratch.mkdir(parents=True)
    private.write_text("secret")
    with socket.create_server(("127.0.0.1", 0)) as server:
        details = {"port": server.getsockname()[1], "private": str(private), "outside": str(outside)}
        source = scratch / "asset.obj"
        source.write_bytes(asset("reach_out", **details))
        work = Work(
            source,
            None,
            {"text": "HI"},
            DEFAULT_BUDGETS,
            scratch,
            private=(tmp_path / "data",),
        )
        with pytest.raises(MeshmarkError) as caught:
            list(run_engine(template, work, Limits(60, 2**32)))
    assert json.loads(caught.value.message) == {
        "connect": "EACCES",
        "listen": "EACCES",
        "read_private": "EACCES",
        "write_outside": "EACCES",
        "read_worker": "EACCES",
        "read_template": "EACCES",
        "write_much": "EFBIG",
        "write_own": "done",
    }
    assert not outside.exists()


def test_what_is_in_force_can_be_asked_without_entering(tmp_path: Path) -> None:
    assert probe(tmp_path, [tmp_path]) == {"files": True, "network": True}
    (tmp_path / "file").write_text("this process is free")
    socket.socket().close()


def test_other_ways_to_the_network_and_to_other_processes_are_shut(tmp_path: Path) -> None:
    script = (
        "import ctypes, os, sys; from pathlib import Path; from worker.sandbox import enter, SYSTEM_CALLS, X32\n"
        "import platform\n"
        "enter(Path(sys.argv[1]), [])\n"
        "libc = ctypes.CDLL(None, use_errno=True)\n"
        "for number in SYSTEM_CALLS[platform.machine()][1]:\n"
        "    assert libc.syscall(number, 1, 1, 0, 0, 0) == -1 and ctypes.get_errno() == 13, number\n"
        "assert libc.syscall(438, 0, 0, 0) == -1 and ctypes.get_errno() == 13  # pidfd_getfd\n"
        "assert libc.syscall(X32 + 41, 2, 1, 0) == -1 and ctypes.get_errno() == 13\n"
        "assert libc.syscall(39) > 0 or platform.machine() != 'x86_64'\n"
        "assert libc.prctl(39, 0, 0, 0, 0) == 1  # PR_GET_NO_NEW_PRIVS\n"
        "os.execv(sys.executable, [sys.executable, '-c', 'import socket; socket.socket()'])\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True)
    assert "PermissionError" in ended.stderr, ended.stderr
    assert "execv" not in ended.stderr
    assert ended.returncode == 1
