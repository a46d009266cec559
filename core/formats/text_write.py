"""Tables of numbers as lines of text."""

import numpy as np
from numpy.typing import NDArray

_BLOCK = 2**17  # rows formatted at a time: bounds the memory of their Python numbers


def lines(pattern: str, values: NDArray[np.float64] | NDArray[np.int64]) -> bytes:
    """A line for each row of ``values`` (N, K): ``pattern`` with K fields; ``%r`` gives doubles all their digits."""
    return b"".join(
        ((pattern + "\n") * len(block) % tuple(block.ravel().tolist())).encode()
        for block in (values[at : at + _BLOCK] for at in range(0, len(values), _BLOCK))
    )
