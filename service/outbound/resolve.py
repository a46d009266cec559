"""From a host to the addresses that may be connected to."""

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
    """The addresses of a host as the system finds them.

    Raises:
        OSError: it finds none.
    """
    return [str(found[4][0]) for found in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)]


def check_address(url: str, policy: Policy) -> None:
    """Refuse a URL that is not permitted whatever addresses its host has. Nobody is asked for them.

    Raises:
        MeshmarkError: ``address_refused``.
    """
    target = parse_target(url, policy)
    if target.address:
        _refuse([target.address], target, policy)


def resolve(target: Target, policy: Policy, resolver: Resolver, seconds: float) -> list[Address]:
    """Ask once for a target's addresses; all of them must be permitted, or none is.

    The message does not tell the addresses of a host that is refused: whoever asks shall not learn the inner network.

    Raises:
        MeshmarkError: ``address_refused``.
        Unreachable: the host has no address, or none was found in time.
    """
    addresses = [target.address] if target.address else _ask(target.host, resolver, seconds)
    _refuse(addresses, target, policy)
    return addresses


def _refuse(addresses: Sequence[Address], target: Target, policy: Policy) -> None:
    for address in addresses:
        if kind := refusal(address, policy.allow):
            raise address_refused(f"The host {target.host} has an address that is not public, but {kind}.")


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
    if isinstance(answer, OSError) or not answer:
        raise Unreachable("its name has no address")
    if isinstance(answer, Exception):
        raise answer
    return [ip_address(text) for text in dict.fromkeys(answer)]
