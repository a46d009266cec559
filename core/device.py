"""Device that placement is computed on: the CPU, or a CUDA device."""

import os
from enum import StrEnum
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.geometry.spatial import SpatialIndex


class Device(StrEnum):
    """Devices, as torch and warp name them."""

    CPU = "cpu"
    CUDA = "cuda"


def device() -> Device:
    """The one that ``MESHMARK_DEVICE`` names; for ``auto``, the default, CUDA where it is usable.

    Raises:
        MeshmarkError: ``device_unavailable`` where ``cuda`` is named and not usable, and for any other name.
    """
    named = os.environ.get("MESHMARK_DEVICE", "auto")
    if named == Device.CPU:
        return Device.CPU
    if named not in ("auto", Device.CUDA):
        raise MeshmarkError(
            ErrorCode.DEVICE_UNAVAILABLE,
            f"There is no device {named!r}, which MESHMARK_DEVICE names.",
            "Set MESHMARK_DEVICE to auto, cpu or cuda.",
        )
    why_not = obstacle()
    if why_not is None:
        return Device.CUDA
    if named == Device.CUDA:
        raise MeshmarkError(
            ErrorCode.DEVICE_UNAVAILABLE,
            f"MESHMARK_DEVICE asks for CUDA, but {why_not}.",
            "Install meshmark[cuda] and NVIDIA's driver, or set MESHMARK_DEVICE to auto or cpu.",
        )
    return Device.CPU


def spatial_index(
    positions: NDArray[np.float64],
    faces: NDArray[np.int64],
    ids: NDArray[np.int64],
    hides: NDArray[np.uint8] | None = None,
) -> SpatialIndex:
    """The index over ``faces[ids]`` on :func:`device`; arguments as for :class:`SpatialIndex`."""
    if device() is Device.CPU:
        return SpatialIndex(positions, faces, ids, hides)
    from core.geometry.spatial_warp import WarpIndex

    return WarpIndex(positions, faces, ids, hides, Device.CUDA)


def obstacle() -> str | None:
    """The reason why CUDA cannot be used; None where it can. Torch and warp are loaded only where both are installed:
    it takes seconds."""
    if find_spec("warp") is None:
        return "warp-lang is not installed"
    import torch

    if not torch.cuda.is_available():
        return "torch finds no CUDA device"
    import warp

    return None if warp.is_cuda_available() else "warp finds no CUDA device"
