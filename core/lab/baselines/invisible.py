"""A blind invisible watermark to compare with: bits in the distribution of the vertices' distances from the centre.

Cho, Prost and Jung, "An Oblivious Watermarking for 3-D Polygonal Meshes Using Distribution of Vertex Norms", IEEE
Transactions on Signal Processing 55(1), 2007, method I (shifting the mean). It replaces the method of Wang et al. that
the paper compares with; both are blind. Differences from the publication: bins hold equally many vertices instead of
spanning equal distances, so that none is empty on meshes with a few far vertices, and embedding is repeated until the
bits can be read, since moving vertices also moves their centre.
"""

import numpy as np

from core.arrays import Bool, Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.lab.plain import Mesh

LENGTH = 64  # bits, as in the publication
STRENGTH = 0.05  # shift of a bin's mean from one half, in widths of the bin; the publication tries 0.03 to 0.07
PER_BIT = 4  # distinct distances, at least: a bin's nearest and farthest delimit it, only those between can move
ROUNDS = 20  # of embedding, at most
HALVINGS = 50


def embed(mesh: Mesh, bits: Bool, strength: float = STRENGTH) -> Mesh:
    """``mesh`` with ``bits`` in its vertices' distances from their mean; faces stay as they are.

    The distances are sorted into as many bins as bits. In each, scaled to [0, 1], they are raised to the power that
    brings their mean to 0.5 + strength for a one, or 0.5 - strength for a zero, unless it is beyond that already.

    Args:
        mesh: vertices at equal positions move together.
        bits: (L,) bool, at least one.
        strength: in (0, 0.5).

    Raises:
        MeshmarkError: ``no_placement`` if the mesh has too few vertices for the bits, or so many at equal distances
            that the bits cannot be read back.
    """
    positions, source = np.unique(mesh.positions, axis=0, return_inverse=True)
    bits = np.asarray(bits, dtype=bool)
    for _ in range(ROUNDS):
        center, norms = _norms(positions)
        target = norms.copy()
        for bit, members in zip(bits, _bins(norms, len(bits)), strict=True):
            target[members] = _shifted(norms[members], bool(bit), strength)
        factor = np.divide(target, norms, out=np.ones_like(norms), where=norms > 0)
        positions = center + (positions - center) * factor[:, None]
        marked = Mesh(positions[source.ravel()], mesh.faces)
        if np.array_equal(extract(marked, len(bits)), bits):
            return marked
    raise MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"The {len(positions)} vertices of this file lie at too few different distances from its centre to hold "
        f"{len(bits)} bits.",
        "Embed fewer bits, or use a mesh of less symmetric shape.",
    )


def extract(mesh: Mesh, length: int = LENGTH) -> Bool:
    """(length,) bool, the bits that are read from ``mesh``, also where none were embedded.

    Raises:
        MeshmarkError: ``no_placement`` if the mesh has too few vertices for that many bits.
    """
    _, norms = _norms(np.unique(mesh.positions, axis=0))
    return np.array([_scaled(norms[members]).mean() > 0.5 for members in _bins(norms, length)])


def bit_accuracy(embedded: Bool, extracted: Bool) -> float:
    """The share of equal bits of two (L,) arrays; guessing has one half."""
    return float(np.mean(embedded == extracted))


def _norms(positions: Float) -> tuple[Float, Float]:
    center = positions.mean(axis=0)
    return center, np.asarray(np.linalg.norm(positions - center, axis=1))


def _bins(norms: Float, count: int) -> list[Int]:
    """The vertices (indices) in ``count`` bins of equally many, from near to far."""
    if len(norms) < PER_BIT * count:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"This file has {len(norms)} vertices; {count} bits need at least {PER_BIT * count}.",
            "Embed fewer bits or use a finer mesh.",
        )
    return np.array_split(np.argsort(norms, kind="stable"), count)


def _scaled(norms: Float) -> Float:
    low, span = norms.min(), np.ptp(norms)
    return (norms - low) / span if span > 0 else np.full(len(norms), 0.5)


def _shifted(norms: Float, bit: bool, strength: float) -> Float:
    """One bin's distances with their mean moved to the bit's side; the nearest and the farthest stay."""
    scaled = _scaled(norms)
    goal = 0.5 + strength if bit else 0.5 - strength
    if (scaled.mean() >= goal) == bit:
        return norms
    # The mean falls as the exponent grows; the publication searches it in steps, halving an interval is exact.
    low, high = np.log(0.01), np.log(100.0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if (scaled ** np.exp(middle)).mean() > goal:
            low = middle
        else:
            high = middle
    return np.asarray(norms.min() + np.ptp(norms) * scaled ** np.exp(low if bit else high))
