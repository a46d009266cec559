"""SIGHUP, which a closing terminal sends, ends a process as SIGTERM does."""

import signal
from collections.abc import Callable
from typing import Any


def hangup_handler() -> Callable[..., Any] | signal.Handlers:
    """Handler of SIGHUP; where it is ignored, as under `nohup`, it stays so."""
    return signal.SIG_IGN if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else _as_termination


def _as_termination(*_: object) -> None:
    signal.raise_signal(signal.SIGTERM)
