"""kombu's Redis broker, except that a lost acknowledgement no longer occupies a worker's prefetch slot.

kombu forgets a delivered message once Redis has confirmed its acknowledgement. If Redis is restarted at that moment, it
never does: a worker whose slots are all occupied in that way asks for no more messages, does not even notice that its
connection is gone, and stays idle for good. Forgetting is safe: at worst, the message comes once more.
"""

from typing import Any

from kombu.transport import redis, virtual


class QoS(redis.QoS):
    """Delivered messages that are not acknowledged yet."""

    def ack(self, delivery_tag: str) -> None:
        """Forget a message, whether or not Redis can be told."""
        try:
            super().ack(delivery_tag)  # type: ignore[no-untyped-call]
        except self.channel.connection_errors:
            virtual.QoS.ack(self, delivery_tag)  # type: ignore[no-untyped-call]
            raise


class Channel(redis.Channel):
    """Channel with this QoS."""

    QoS = QoS


class Transport(redis.Transport):
    """The transport behind `redis://` and `rediss://`."""

    Channel: Any = Channel
