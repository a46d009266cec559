"""An HTTP client for addresses that users name.

The host is resolved once, every address it has is checked, and the connection goes to one of those very addresses:
a name that answers differently the second time (DNS rebinding) gains nothing. Redirects are answers like any other,
proxies in the environment are ignored, and no content coding is decoded.
"""

import ssl
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import httpcore2

from core import __version__
from service.outbound.connection import Deadline, PinnedBackend
from service.outbound.errors import Unreachable
from service.outbound.policy import Policy, Timeouts
from service.outbound.resolve import Resolver, resolve, system_resolver
from service.outbound.target import parse_target

OWN_HEADERS = {"User-Agent": f"Meshmark/{__version__}", "Accept-Encoding": "identity", "Connection": "close"}


@dataclass(frozen=True)
class Answer:
    """An HTTP response: its header names are in lower case, its body comes as it was sent, chunk by chunk."""

    status: int
    headers: Mapping[str, str]
    body: Iterator[bytes]


class OutboundClient:
    """Sends requests within a policy. Connections are not kept; the client may be shared between threads.

    Args:
        policy: destinations that are permitted.
        timeouts: of each request.
        resolver: finds a host's addresses.
        tls: context that checks certificates; by default against the system's authorities, or `SSL_CERT_FILE`.
    """

    def __init__(
        self,
        policy: Policy,
        timeouts: Timeouts | None = None,
        resolver: Resolver = system_resolver,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._policy = policy
        self._timeouts = timeouts or Timeouts()
        self._resolver = resolver
        self._tls = tls or httpcore2.default_ssl_context()

    @contextmanager
    def send(
        self, method: str, url: str, headers: Mapping[str, str] | None = None, content: bytes | None = None
    ) -> Iterator[Answer]:
        """Response to one request; its body can be read inside the block.

        Raises:
            MeshmarkError: ``address_refused``: nothing was sent.
            Unreachable: no answer came, or it broke off; also while the body is read.
        """
        deadline = Deadline(self._timeouts.total)
        target = parse_target(url, self._policy)
        with self._reported():
            addresses = resolve(target, self._policy, self._resolver, deadline.remaining())
            location = httpcore2.URL(scheme=target.scheme, host=target.host, port=target.port, target=target.path)
            connection = httpcore2.HTTPConnection(
                location.origin, ssl_context=self._tls, network_backend=PinnedBackend(addresses, deadline)
            )
            fields = {**(headers or {}), **OWN_HEADERS, "Host": target.authority}
            with (
                connection,
                connection.stream(
                    method, location, headers=[*fields.items()], content=content, extensions={"timeout": self._limits()}
                ) as response,
            ):
                yield Answer(response.status, _joined(response.headers), response.iter_stream())

    def _limits(self) -> dict[str, float]:
        return {"connect": self._timeouts.connect, "read": self._timeouts.silence, "write": self._timeouts.silence}

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Translate transport errors to Unreachable."""
        try:
            yield
        except httpcore2.TimeoutException as error:
            raise Unreachable(
                f"it did not answer in time (at most {self._timeouts.silence:g} seconds of silence and "
                f"{self._timeouts.total:g} seconds in all)"
            ) from error
        except httpcore2.ConnectError as error:
            cause = error.__cause__
            if isinstance(cause, ssl.SSLCertVerificationError):
                raise Unreachable(f"its certificate is not valid: {cause.verify_message}") from error
            raise Unreachable("no connection to it could be made") from error
        except (httpcore2.NetworkError, httpcore2.ProtocolError) as error:
            raise Unreachable("it broke off, or did not speak HTTP as it should") from error


def _joined(headers: Iterable[tuple[bytes, bytes]]) -> dict[str, str]:
    """Header fields by name; fields of the same name are joined to one list (RFC 9110, 5.2)."""
    joined: dict[str, str] = {}
    for raw_name, raw_value in headers:
        name, value = raw_name.decode("latin-1").lower(), raw_value.decode("latin-1")
        joined[name] = f"{joined[name]}, {value}" if name in joined else value
    return joined
