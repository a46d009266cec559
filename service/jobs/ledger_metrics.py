"""What the ledger knows of the jobs that have not ended, looked up when Prometheus asks.

Only those: what has ended may be many millions, and is counted by the process that ended it.
"""

from collections.abc import Iterator

import structlog
from prometheus_client import Metric
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.ledger import ACTIVE, now
from service.jobs.models import DeliveryState, Job, JobState, WebhookDelivery

log = structlog.get_logger(__name__)


class LedgerCollector(Collector):
    """Jobs by state, how long the oldest one waits, and webhooks that are to be sent."""

    def __init__(self, sessions: sessionmaker[Session]) -> None:
        self._sessions = sessions

    def collect(self) -> Iterator[Metric]:
        """The figures of this moment; where the ledger does not answer, that alone."""
        up = GaugeMetricFamily("meshmark_ledger_up", "1 where the ledger answered, else 0.")
        try:
            with self._sessions() as session:
                active = select(Job.state, func.count(), func.min(Job.created_at)).where(Job.state.in_(ACTIVE))
                pending = select(func.count()).where(WebhookDelivery.state == DeliveryState.PENDING)
                webhooks = session.scalar(pending) or 0
                rows = {state: (count, oldest) for state, count, oldest in session.execute(active.group_by(Job.state))}
        except OperationalError as error:
            log.error("the job ledger does not answer", error=str(error.orig))
            up.add_metric([], 0)
            yield up
            return
        up.add_metric([], 1)
        yield up
        jobs = GaugeMetricFamily("meshmark_jobs", "Jobs that wait (queued) or run.", labels=["state"])
        for state in ACTIVE:
            jobs.add_metric([state], rows[state][0] if state in rows else 0)
        yield jobs
        oldest = GaugeMetricFamily("meshmark_queue_oldest_seconds", "Since the acceptance of the oldest waiting job.")
        waiting = rows.get(JobState.QUEUED)
        oldest.add_metric([], max(0.0, (now() - waiting[1]).total_seconds()) if waiting else 0)
        yield oldest
        to_send = GaugeMetricFamily("meshmark_webhooks_pending", "Webhooks that are to be sent, or sent again.")
        to_send.add_metric([], webhooks)
        yield to_send
