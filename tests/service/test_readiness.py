import asyncio
import threading

import pytest

from service import readiness
from service.readiness import Readiness
from tests.worker.waiting import PATIENCE


def test_a_part_that_hangs_is_named_in_time_and_holds_one_thread_however_often_it_is_asked_about(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(readiness, "CACHED", 0.0)
    monkeypatch.setattr(readiness, "TIMEOUT", 1.0)
    over, calls = threading.Event(), []

    def hang() -> None:
        calls.append("hang")
        over.wait(PATIENCE)

    async def ask() -> list[list[str]]:
        parts = Readiness({"sound": lambda: calls.append("sound"), "hanging": hang})
        answers = [await parts.failing() for _ in range(3)]
        over.set()  # else the loop would wait for the thread
        return answers

    assert asyncio.run(ask()) == [["hanging"]] * 3
    assert calls.count("hang") == 1
    assert calls.count("sound") == 3


def test_all_parts_are_looked_at_together_and_no_more_often_than_an_answer_holds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(readiness, "TIMEOUT", PATIENCE)
    monkeypatch.setattr(readiness, "CACHED", PATIENCE)
    together, looks = threading.Barrier(3), []

    def meet() -> None:
        looks.append(1)
        together.wait(PATIENCE)

    async def ask() -> list[str]:
        parts = Readiness({"a": meet, "b": meet, "c": meet})
        await asyncio.gather(*(parts.failing() for _ in range(20)))
        return await parts.failing()

    assert asyncio.run(ask()) == []
    assert len(looks) == 3
