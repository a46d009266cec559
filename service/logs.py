"""Logs: readable lines on a terminal, one JSON object per line otherwise."""

import logging
import sys
from types import TracebackType
from typing import Any

import structlog

# Loggers of messages, connections and starts that the service logs itself.
CHATTY = ("alembic", "celery", "kombu", "sqlalchemy", "service.jobs.database.Pool", "uvicorn.error")


def configure_logs(level: str) -> None:
    """Send structlog's and the standard library's records (uvicorn, celery) through one formatter to stderr."""
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    on_terminal = sys.stderr.isatty()
    final: list[Any] = (
        [structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)]
        if on_terminal
        else [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
    )
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *final],
        )
    )
    logging.basicConfig(handlers=[handler], level=level, force=True)
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught
    if level != "DEBUG":
        for chatty in CHATTY:
            logging.getLogger(chatty).setLevel("WARNING")


def _log_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Log an uncaught exception in the log's format."""
    structlog.get_logger(__name__).critical("the process failed", exc_info=(kind, error, trace))
