"""Queue of webhooks, apart from that of jobs, so that slow endpoints do not delay the watermarking.

A message is a delivery's id and nothing else; it may be lost or arrive twice, because the ledger alone decides.
"""

from celery import Celery

QUEUE = "meshmark.webhooks"
TASK = "meshmark.deliver"


def send(broker: Celery, delivery_id: str) -> None:
    """Announce a webhook that is due.

    Raises:
        kombu.exceptions.OperationalError: the broker cannot be reached.
    """
    broker.send_task(TASK, args=[delivery_id], queue=QUEUE)


def is_empty(broker: Celery) -> bool:
    """Test whether no message waits in the broker."""
    with broker.connection_for_write() as connection, connection.channel() as channel:
        return not channel.queue_declare(QUEUE, durable=True, auto_delete=False).message_count
