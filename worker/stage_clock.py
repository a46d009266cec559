"""Durations of an attempt's stages, for metrics and traces."""

import time
from types import TracebackType
from typing import Self

from opentelemetry.trace import INVALID_SPAN, Span

from service.metrics import STAGE_SECONDS
from service.tracing import tracer

# Stages of core.pipeline; any other name from a child, which has read a hostile file, is "other".
STAGES = ("reading", "lettering", "placing", "embossing", "writing", "reporting", "rendering", "evaluating")
OTHER = "other"


def known(stage: str) -> str:
    """Stage that a child named, if it is one, else "other"."""
    return stage if stage in STAGES else OTHER


class StageClock:
    """Timer of the engine's stages: an observation and a span for each."""

    def __init__(self) -> None:
        self._stage: str | None = None
        self._since = 0.0
        self._span: Span = INVALID_SPAN

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.at(None)

    def at(self, stage: str | None) -> None:
        """Enter a stage; None: leave the current one."""
        stage = None if stage is None else known(stage)
        if stage == self._stage:
            return
        moment = time.monotonic()
        if self._stage is not None:
            STAGE_SECONDS.labels(self._stage).observe(moment - self._since)
            self._span.end()
        self._stage, self._since = stage, moment
        self._span = INVALID_SPAN if stage is None else tracer.start_span(stage)
