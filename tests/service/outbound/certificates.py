"""A certificate authority of the tests' own, and who believes it."""

import ssl
from datetime import datetime

import trustme

AUTHORITY = trustme.CA()


def trusting() -> ssl.SSLContext:
    """What a client needs to believe the authority."""
    context = ssl.create_default_context()
    AUTHORITY.configure_trust(context)
    return context


def certified(name: str, issuer: trustme.CA = AUTHORITY, not_after: datetime | None = None) -> ssl.SSLContext:
    """What a server needs to be believed under a name."""
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    issuer.issue_cert(name, not_after=not_after).configure_cert(context)
    return context
