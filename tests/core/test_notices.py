"""What is said although nothing failed."""

from dataclasses import astuple

from core.errors import ErrorCode, MeshmarkError
from core.notices import NoticeCode
from service.errors import ServiceErrorCode


def test_an_error_that_fails_nothing_says_the_same_as_a_notice() -> None:
    error = MeshmarkError(ErrorCode.RENDERING_UNAVAILABLE, "No EGL here.", "Install it.")
    assert astuple(error.notice()) == ("rendering_unavailable", "No EGL here.", "Install it.")


def test_a_code_is_that_of_a_notice_or_of_an_error_and_says_its_name() -> None:
    assert {*NoticeCode}.isdisjoint({*ErrorCode, *ServiceErrorCode})
    assert all(code.value == code.name.lower() for code in NoticeCode)
