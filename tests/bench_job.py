"""One job as in the running service, for `tests.bench`: a process that has loaded the libraries forks one that runs.

Run by its path, with the tree to be measured on PYTHONPATH, and so written for older commits too: of the engine it uses
`preload`, `watermark` and `parse_parameters`. Prints as JSON what the forked process alone took, and the SHA-256 of the
model.
"""

import json
import os
import sys
import time
import traceback
from hashlib import sha256
from pathlib import Path
from typing import NoReturn

from core.parameters import parse_parameters
from core.pipeline import watermark
from core.preload import preload


def main(asset: Path, text: str, evaluate: str) -> int:
    """Run the job; the status is not 0 where it failed, and standard error says why."""
    preload()
    ours, theirs = os.pipe()
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        _work(asset, text, evaluate, theirs)
    _, status, usage = os.wait4(child, 0)
    wall = time.perf_counter() - start
    if status:
        return os.waitstatus_to_exitcode(status) or 1
    took = {"wall": wall, "user": usage.ru_utime, "system": usage.ru_stime, "peak": usage.ru_maxrss}
    print(json.dumps(took | {"sha256": os.read(ours, 64).decode()}))
    return 0


def _work(asset: Path, text: str, evaluate: str, answer: int) -> NoReturn:
    """The job itself; without metrics there is no preview either. Ends the process without any teardown."""
    try:
        parameters = parse_parameters({"text": text, "evaluate": evaluate})
        result = watermark(asset.read_bytes(), parameters, preview=evaluate != "none")
        os.write(answer, sha256(result.model).hexdigest().encode())
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), *sys.argv[2:4]))
