"""kombu's Redis broker, except that a message whose acknowledgement gets lost no longer takes a worker's place.

kombu forgets a delivered message once Redis has confirmed that it is done. Where Redis is restarted at that moment, it
never forgets it: a worker all of whose places are taken that way asks for no more messages, and so does not even notice
that its connection is gone. It lives, and never works again. Forgetting is safe: at worst, the message comes once more.
"""

from typing import Any

from kombu.transport import redis, virtual


class QoS(redis.QoS):
    """What was delivered and is not yet done."""

    def ack(self, delivery_tag: str) -> None:
        """Forget a message, whether or not Redis can be told."""
        try:
            super().ack(delivery_tag)  # type: ignore[no-untyped-call]
        except self.channel.connection_errors:
            virtual.QoS.ack(self, delivery_tag)  # type: ignore[no-untyped-call]
            raise


class Channel(redis.Channel):
    """One whose messages are counted so."""

    QoS = QoS


class Transport(redis.Transport):
    """The transport behind `redis://` and `rediss://`."""

    Channel: Any = Channel
