"""Products and inverses of matrices in a fixed order of additions.

BLAS and LAPACK add in an order, and fuse multiplications and additions, as suits the processor: the last bits differ
from one kind of processor to another, and with them whatever is decided by comparing results. Here each sum is taken
in the order of its terms, by operations that IEEE 754 rounds the same way everywhere.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float

FEW = 4  # columns of a product up to which it is taken column by column, which is two to three times as fast


def product(a: NDArray[Any], b: NDArray[Any]) -> Float:
    """``a @ b`` of (..., I, K) and (..., K, J), for small K."""
    if a.ndim == b.ndim == 2 and 0 < b.shape[1] <= FEW:
        return applied(b.T, a)
    total = a[..., :, :1] * b[..., :1, :]
    term = np.empty_like(total)
    for k in range(1, a.shape[-1]):
        np.multiply(a[..., :, k : k + 1], b[..., k : k + 1, :], out=term)
        total += term
    return np.asarray(total)


def dot(one: Float, other: Float) -> Float:
    """(...) inner products of vectors (..., K), for small K."""
    total = one[..., 0] * other[..., 0]
    for k in range(1, one.shape[-1]):
        total += one[..., k] * other[..., k]
    return np.asarray(total)


def length(vectors: Float) -> Float:
    """(...) lengths of vectors (..., K), for small K: those of ``np.linalg.norm``, bit for bit, in half the time."""
    return np.sqrt(dot(vectors, vectors))


def applied(matrices: Float, vectors: Float) -> Float:
    """(..., I) products ``matrices @ vectors`` of (..., I, K) and (..., K), broadcast, for small I and K."""
    return np.stack([dot(matrices[..., row, :], vectors) for row in range(matrices.shape[-2])], axis=-1)


def cross(one: Float, other: Float) -> Float:
    """(..., 3) cross products of vectors, broadcast: those of ``np.cross``, bit for bit, in a quarter of the time."""
    result = np.empty(np.broadcast_shapes(one.shape, other.shape))
    for axis, (first, second) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(one[..., first], other[..., second], out=result[..., axis])
        result[..., axis] -= one[..., second] * other[..., first]
    return result


def solved(matrices: Float, right: Float) -> Float:
    """(..., 3) the x with ``matrices @ x = right``, for (..., 3, 3) and (..., 3), by Cramer's rule; not finite where a
    matrix is singular."""
    x, y, z = (matrices[..., :, axis] for axis in range(3))
    by_row = np.stack([cross(y, z), cross(z, x), cross(x, y)], axis=-2)
    determinant = dot(by_row[..., 0, :], x)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return applied(by_row, right) / determinant[..., None]
