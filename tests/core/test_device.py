import pytest
import torch

from core.device import Device, device, spatial_index
from core.errors import ErrorCode, MeshmarkError
from tests.core.shapes import box

CUDA = torch.cuda.is_available()


def test_cuda_is_used_where_there_is_any(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MESHMARK_DEVICE", raising=False)
    by_default = device()
    monkeypatch.setenv("MESHMARK_DEVICE", "auto")
    assert device() == by_default == (Device.CUDA if CUDA else Device.CPU)


def test_the_cpu_is_used_where_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", "cpu")
    cube = box(2.0, 2.0, 2.0)
    index = spatial_index(cube.positions, cube.faces, cube.face_triangle)
    assert (device(), index.device) == (Device.CPU, "cpu")
    assert index.closest(cube.positions)[0].max() == 0


def test_cuda_that_is_named_is_used_or_refused_but_never_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", "cuda")
    cube = box(2.0, 2.0, 2.0)
    if CUDA:
        assert spatial_index(cube.positions, cube.faces, cube.face_triangle).device == Device.CUDA
    else:
        with pytest.raises(MeshmarkError, match="torch finds no CUDA device") as caught:
            spatial_index(cube.positions, cube.faces, cube.face_triangle)
        assert caught.value.code is ErrorCode.DEVICE_UNAVAILABLE
        assert "meshmark[cuda]" in caught.value.remedy


def test_cuda_without_warp_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", "cuda")
    monkeypatch.setattr("core.device.find_spec", lambda _name: None)
    with pytest.raises(MeshmarkError, match="warp-lang is not installed"):
        device()


@pytest.mark.parametrize("name", ["", "gpu", "CUDA"])
def test_a_device_that_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", name)
    with pytest.raises(MeshmarkError, match="There is no device") as caught:
        device()
    assert caught.value.code is ErrorCode.DEVICE_UNAVAILABLE
    assert "auto, cpu or cuda" in caught.value.remedy
