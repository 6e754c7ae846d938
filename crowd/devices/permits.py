"""Permits to send simulated data: an administrator of the server makes one, for a day.

What comes in under it is labelled for good: its devices are models of a kind of their own.
"""

from django.core.signing import BadSignature, TimestampSigner

from crowd.audit.services import COMMAND_LINE, record

SECONDS = 24 * 3600
SUBJECT, SALT = "simulated", "permit to simulate"


def permit() -> str:
    """A new permit to enrol simulated installations at this server."""
    return TimestampSigner(salt=SALT).sign(SUBJECT)


def issue() -> str:
    """A new permit to be handed out; the audit log says so."""
    record(COMMAND_LINE, "permit issued", "simulated crowd", f"valid for {SECONDS // 3600} hours")
    return permit()


def is_valid(text: str) -> bool:
    """Whether TEXT is a permit of this server that is still good."""
    try:
        return TimestampSigner(salt=SALT).unsign(text, max_age=SECONDS) == SUBJECT
    except BadSignature:
        return False
