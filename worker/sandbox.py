"""Sandbox of processes that read hostile input: they drop every right that they do not need.

- The network: a seccomp filter refuses to create sockets of any kind, and io_uring, which could create them past it. It
  also refuses access to other processes' memory and descriptors. (An inherited descriptor stays usable: there
  are a socket to the worker and two files.)
- Files: Landlock lets the process write in its own folder only, and read nothing in the private folders, which hold
  other tenants' files, the ledger and secrets, and of `/proc` only its own entry.
- Its process group, which it cannot leave: its children are killed with it.
- Privileges: executed programs gain none (`no_new_privs`).

Linux only; no privileges are needed, so it works in a container and for any user. Missing protections are reported.

`python -m worker.sandbox FOLDER` tries it and prints the protections in force.
"""

import ctypes
import json
import os
import platform
import struct
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER = 38, 22, 2  # linux/prctl.h, linux/seccomp.h
# linux/audit.h, and the numbers of: socket, ptrace, process_vm_readv, process_vm_writev, io_uring_setup, pidfd_getfd,
# setpgid, setsid
SYSTEM_CALLS = {
    "x86_64": (0xC000003E, (41, 101, 310, 311, 425, 438, 109, 112)),
    "aarch64": (0xC00000B7, (198, 117, 270, 271, 425, 438, 154, 157)),
}
X32 = 0x40000000  # system calls of the x32 ABI are numbered from here on
# linux/bpf_common.h: load a word, jump if equal, jump if greater or equal, return
LOAD, EQUAL, GREATER, RETURN = 0x20, 0x15, 0x35, 0x06
# linux/seccomp.h
ALLOW, KILL, REFUSE = 0x7FFF0000, 0x80000000, 0x00050000 | 13  # EACCES

# System calls of Landlock, and LANDLOCK_CREATE_RULESET_VERSION, LANDLOCK_RULE_PATH_BENEATH of linux/landlock.h
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
GET_VERSION, PATH_BENEATH = 1, 1
# linux/landlock.h: execute, write, read file, read folder; then removal, creation, renaming and truncation
EXECUTE, WRITE, READ_FILE, READ_FOLDER = 1, 2, 4, 8
RIGHTS_BY_VERSION = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1}
FILE_RIGHTS = EXECUTE | WRITE | READ_FILE | 1 << 14  # rights that files can have; the last is truncation
LIBRARIES = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
DEVICES, SHARED = Path("/dev"), ("shm", "mqueue", "pts")  # devices, and those among them that other processes share

libc = ctypes.CDLL(None, use_errno=True)


def enter(folder: Path, private: Iterable[Path], writable: Iterable[Path] = ()) -> dict[str, bool]:
    """Give up, for good and for all children, the network, other processes, and files beyond those needed.

    Call it while the process has one thread.

    Args:
        folder: working folder, in which everything is allowed.
        private: folders of which nothing but `folder` may be read.
        writable: other folders in which everything is allowed, where they exist.

    Returns:
        Protections in force: ``network`` and ``files``.
    """
    if sys.platform != "linux" or libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
        return {"network": False, "files": False}
    devices = [path for path in DEVICES.iterdir() if path.name not in SHARED]
    os.open(f"/proc/{os.getpid()}", os.O_PATH)  # stays open: the rule holds for the entry while it is in use
    readable = _all_but([*(path.resolve() for path in private), *_other_processes()])
    return {"files": _restrict_files(readable, [folder, *devices, *writable]), "network": _refuse_sockets()}


def shut(readable: Iterable[Path] = ()) -> dict[str, bool]:
    """Give up the network, other processes, all writing, and all reading but of installed libraries, which import parts
    of themselves late. Descriptors opened before stay usable.

    Call it while the process has one thread.

    Args:
        readable: other folders that may be read, where they exist.

    Returns:
        As :func:`enter`.
    """
    if sys.platform != "linux" or libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
        return {"network": False, "files": False}
    return {"files": _restrict_files([*map(Path, sorted(set(LIBRARIES))), *readable], []), "network": _refuse_sockets()}


def probe(folder: Path, private: Iterable[Path]) -> dict[str, bool]:
    """Protections that would be in force here, tried in a process of its own."""
    command = [sys.executable, "-m", "worker.sandbox", os.fspath(folder), *map(os.fspath, private)]
    return dict(json.loads(subprocess.run(command, check=True, capture_output=True).stdout))


def _refuse_sockets() -> bool:
    if platform.machine() not in SYSTEM_CALLS:
        return False
    architecture, refused = SYSTEM_CALLS[platform.machine()]
    number, arch = 0, 4  # offsets in struct seccomp_data
    count = len(refused)
    program = [
        (LOAD, 0, 0, arch),
        (EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, KILL),
        (LOAD, 0, 0, number),
        (GREATER, count + 1, 0, X32),
        *((EQUAL, count - position, 0, call) for position, call in enumerate(refused)),
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, REFUSE),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in program))
    holder = struct.pack("HP", len(program), ctypes.addressof(code))  # struct sock_fprog
    return bool(libc.prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, ctypes.c_char_p(holder), 0, 0) == 0)


def _restrict_files(readable: Iterable[Path], writable: Iterable[Path]) -> bool:
    version = libc.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), GET_VERSION)
    if version < 1:
        return False
    rights = RIGHTS_BY_VERSION[min(version, 3)]
    ruleset = libc.syscall(CREATE_RULESET, struct.pack("Q", rights), ctypes.c_size_t(8), 0)
    if ruleset < 0:
        return False
    try:
        for path in readable:
            _allow(ruleset, path, rights & (EXECUTE | READ_FILE | READ_FOLDER))
        for path in writable:
            _allow(ruleset, path, rights)
        return bool(libc.syscall(RESTRICT_SELF, ruleset, 0) == 0)
    finally:
        os.close(ruleset)


def _allow(ruleset: int, path: Path, rights: int) -> None:
    try:
        handle = os.open(path, os.O_PATH)
    except OSError:  # gone, or not to be seen anyhow
        return
    try:
        if not path.is_dir():
            rights &= FILE_RIGHTS
        rule = struct.pack("=Qi", rights, handle)  # struct landlock_path_beneath_attr
        libc.syscall(ADD_RULE, ruleset, PATH_BENEATH, rule, 0)
    finally:
        os.close(handle)


def _other_processes() -> Iterator[Path]:
    """Entries of other processes in `/proc`, whose environments hold passwords. Later processes get no rule either."""
    return (path for path in Path("/proc").iterdir() if path.name.isdecimal() and path.name != str(os.getpid()))


def _all_but(private: Iterable[Path]) -> Iterator[Path]:
    """Largest parts of the file system without anything private: Landlock knows no exceptions."""
    closed = set(map(os.fspath, private))
    ways = [[os.fspath(parent) for parent in Path(path).parents] for path in closed]
    opened = {folder for way in ways if closed.isdisjoint(way) for folder in way}
    for folder in opened:
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                # The target of a link has a rule of its own, or has none.
                if entry.path not in closed and entry.path not in opened and not entry.is_symlink():
                    yield Path(entry.path)


if __name__ == "__main__":
    print(json.dumps(enter(Path(sys.argv[1]), map(Path, sys.argv[2:]))))
