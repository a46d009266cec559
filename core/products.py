"""Products of matrices in a fixed order of additions.

BLAS adds in an order, and fuses multiplications and additions, as suits the processor: the last bits differ from one
kind of processor to another, and with them whatever is decided by comparing results. Here each sum is taken in the
order of its terms, by operations that IEEE 754 rounds the same way everywhere.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def product(a: NDArray[Any], b: NDArray[Any]) -> Float:
    """``a @ b`` of (..., I, K) and (..., K, J), for small K."""
    total = a[..., :, :1] * b[..., :1, :]
    term = np.empty_like(total)
    for k in range(1, a.shape[-1]):
        np.multiply(a[..., :, k : k + 1], b[..., k : k + 1, :], out=term)
        total += term
    return np.asarray(total)
