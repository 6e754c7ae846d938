"""Permits to send simulated data. An administrator issues one; it is valid for a day.

Simulated data stays labelled: its devices are models of the kind SIMULATED.
"""

from django.core.signing import BadSignature, TimestampSigner

from crowd.audit.services import COMMAND_LINE, record

VALID_SECONDS = 24 * 3600
SUBJECT, SALT = "simulated", "permit to simulate"


def permit() -> str:
    """A new permit to enrol simulated installations at this server."""
    return TimestampSigner(salt=SALT).sign(SUBJECT)


def issue() -> str:
    """A new permit, recorded in the audit log."""
    record(COMMAND_LINE, "permit issued", "simulated crowd", f"valid for {VALID_SECONDS // 3600} hours")
    return permit()


def is_valid(text: str) -> bool:
    """Whether TEXT is a permit of this server that has not expired."""
    try:
        return TimestampSigner(salt=SALT).unsign(text, max_age=VALID_SECONDS) == SUBJECT
    except BadSignature:
        return False
