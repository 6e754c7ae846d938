"""Permits to send simulated data: an administrator of the server makes one, for a day.

What comes in under it is labelled for good: its devices are models of a kind of their own.
"""

from django.core.signing import BadSignature, TimestampSigner

SECONDS = 24 * 3600
SUBJECT, SALT = "simulated", "permit to simulate"


def permit() -> str:
    """A new permit, for whoever enrols simulated installations at this server."""
    return TimestampSigner(salt=SALT).sign(SUBJECT)


def is_valid(text: str) -> bool:
    """Whether TEXT is a permit of this server that is still good."""
    try:
        return TimestampSigner(salt=SALT).unsign(text, max_age=SECONDS) == SUBJECT
    except BadSignature:
        return False
