"""Metrics of the jobs that have not ended, read from the ledger at each scrape; copies that are held back wait for no
worker, and are not among them.

Ended jobs may be many millions; they are counted by the processes that ended them.
"""

from collections.abc import Iterator
from itertools import product

import structlog
from prometheus_client import Metric
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.clock import clock
from service.jobs.models import UNDER_WAY, WAITING, Job, JobState, Queue, WebhookDelivery
from service.jobs.transitions import ACTIVE

log = structlog.get_logger(__name__)


class LedgerCollector(Collector):
    """Collects jobs by state and queue, the age of the oldest waiting job of each queue, and pending webhooks."""

    def __init__(self, sessions: sessionmaker[Session]) -> None:
        self._sessions = sessions

    def collect(self) -> Iterator[Metric]:
        """Yield the current metrics; where the ledger does not answer, that alone."""
        up = GaugeMetricFamily("meshmark_ledger_up", "1 where the ledger answered, else 0.")
        try:
            with self._sessions() as session:
                moment = clock(session)
                figures = (Job.state, Job.queue, func.count(), func.min(Job.created_at))
                active = select(*figures).where(Job.state.in_(ACTIVE), ~Job.held).group_by(Job.state, Job.queue)
                counts = (
                    select(func.count()).select_from(WebhookDelivery).where(*which) for which in (WAITING, UNDER_WAY)
                )
                webhooks = sum(session.scalars(count).one() for count in counts)
                rows = {(state, queue): (count, oldest) for state, queue, count, oldest in session.execute(active)}
        except OperationalError as error:
            log.error("the job ledger does not answer", error=str(error.orig))
            up.add_metric([], 0)
            yield up
            return
        up.add_metric([], 1)
        yield up
        jobs = GaugeMetricFamily("meshmark_jobs", "Jobs that wait (queued) or run.", labels=["state", "queue"])
        for state, queue in product(ACTIVE, Queue):  # all of them: a series that comes and goes cannot be scaled by
            count, _ = rows.get((state, queue), (0, None))
            jobs.add_metric([state, queue], count)
        yield jobs
        since = "Since the acceptance of the oldest waiting job."
        oldest = GaugeMetricFamily("meshmark_queue_oldest_seconds", since, labels=["queue"])
        for queue in Queue:
            _, accepted = rows.get((JobState.QUEUED, queue), (0, None))
            oldest.add_metric([queue], max(0.0, (moment - accepted).total_seconds()) if accepted else 0)
        yield oldest
        to_send = GaugeMetricFamily("meshmark_webhooks_pending", "Webhooks that are to be sent, or sent again.")
        to_send.add_metric([], webhooks)
        yield to_send
