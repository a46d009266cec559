"""Resolution of a host to the addresses that may be connected to."""

import socket
from collections.abc import Callable, Sequence
from ipaddress import ip_address
from queue import Empty, SimpleQueue

from service.background import in_background
from service.outbound.addresses import Address, refusal
from service.outbound.errors import Unreachable, address_refused
from service.outbound.policy import Policy
from service.outbound.target import Target, parse_target

Resolver = Callable[[str], Sequence[str]]


def system_resolver(host: str) -> list[str]:
    """Addresses of a host by the system's resolver.

    Raises:
        OSError: it finds none.
    """
    return [str(found[4][0]) for found in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)]


def check_address(url: str, policy: Policy) -> None:
    """Refuse a URL that is not permitted whatever addresses its host has. No name is resolved.

    Raises:
        MeshmarkError: ``address_refused``.
    """
    target = parse_target(url, policy)
    if target.address:
        _refuse(target.address, policy)


def resolve(target: Target, policy: Policy, resolver: Resolver, seconds: float) -> list[Address]:
    """Resolve a target once; all of its addresses must be permitted, or none is.

    The caller must not learn about the internal network: a name in it is treated as one that does not exist.

    Raises:
        MeshmarkError: ``address_refused``, the host is an address that is not permitted.
        Unreachable: it is a name for which there is none, or for which none was found in time.
    """
    if target.address:
        _refuse(target.address, policy)
        return [target.address]
    addresses = _ask(target.host, resolver, seconds)
    if not addresses or any(refusal(address, policy.allow) for address in addresses):
        raise Unreachable("its name has no public address")
    return addresses


def _refuse(address: Address, policy: Policy) -> None:
    if kind := refusal(address, policy.allow):
        raise address_refused(f"The address {address} is not public, but {kind}.")


def _ask(host: str, resolver: Resolver, seconds: float) -> list[Address]:
    answers: SimpleQueue[Sequence[str] | Exception] = SimpleQueue()

    def ask() -> None:
        try:
            answers.put(resolver(host))
        except Exception as error:
            answers.put(error)

    in_background("resolver", ask)  # getaddrinfo knows no time-out
    try:
        answer = answers.get(timeout=seconds)
    except Empty:
        raise Unreachable(f"its name was not resolved within {seconds:g} seconds") from None
    if isinstance(answer, OSError):
        return []
    if isinstance(answer, Exception):
        raise answer
    return [ip_address(text) for text in dict.fromkeys(answer)]
