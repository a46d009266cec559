"""The same file and parameters give the same bytes whatever processor the mathematical libraries take this for."""

import os
import subprocess
import sys

RUN = """
import hashlib
from pathlib import Path
import numpy as np
import trimesh
from core.choices import Evaluate
from core.parameters import Parameters
from core.pipeline import watermark

ball = trimesh.creation.icosphere(subdivisions=4)
ball.vertices *= 1 + 0.15 * np.sin(3 * ball.vertices[:, [0]]) * np.cos(4 * ball.vertices[:, [1]])
ring = trimesh.creation.torus(1.0, 0.4)
spot = Path("tests/data/spot.glb").read_bytes()
asked = Parameters(text="watermark", count=6, evaluate=Evaluate.NONE)
for data in (spot, ball.export(file_type="ply"), ring.export(file_type="glb")):
    print(hashlib.sha256(watermark(data, asked, preview=False).model).hexdigest())
"""


def hashes(**environment: str) -> list[str]:
    """Of three results, by a process of its own."""
    command = [sys.executable, "-c", RUN]
    ran = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    return ran.stdout.split()


def test_bytes_do_not_depend_on_the_kernels_or_threads_of_numerical_libraries() -> None:
    here = hashes()
    assert len(set(here)) == 3
    # The kernels of OpenBLAS, MKL, torch and numpy for a processor of twenty years ago, and one thread.
    old = {"OPENBLAS_CORETYPE": "Prescott", "MKL_CBWR": "COMPATIBLE", "ATEN_CPU_CAPABILITY": "default"}
    assert hashes(**old, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1") == here
    assert hashes(OPENBLAS_CORETYPE="Haswell", OPENBLAS_NUM_THREADS="3") == here
