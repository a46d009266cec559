from prometheus_client import REGISTRY

from core.pipeline import STAGES as PIPELINE
from worker.stage_clock import OTHER, STAGES, StageClock


def count(stage: str) -> float:
    return REGISTRY.get_sample_value("meshmark_stage_seconds_count", {"stage": stage}) or 0


def test_the_stages_are_those_of_the_engine() -> None:
    assert list(STAGES) == list(PIPELINE)


def test_each_stage_is_measured_once_though_its_progress_is_told_often_and_the_last_when_the_engine_ends() -> None:
    before = {stage: count(stage) for stage in (*STAGES, OTHER)}
    with StageClock() as clock:
        for stage in ("reading", "placing", "placing", "placing", "writing"):
            clock.at(stage)
    assert {stage for stage in before if count(stage) != before[stage]} == {"reading", "placing", "writing"}
    assert count("placing") == before["placing"] + 1


def test_stages_that_the_engines_process_makes_up_are_one() -> None:
    before = count(OTHER)
    with StageClock() as clock:
        for number in range(100):
            clock.at(f"invented {number}")
    assert count(OTHER) == before + 1
