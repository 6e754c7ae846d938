"""Two people for a publication: FRONTRUNNER_SECOND_PERSON demands that another person publishes.

Who drafted and who submitted is read from the audit log, by the content's digest.
"""

from contextlib import suppress
from pathlib import Path

from django.conf import settings

from crowd.audit.models import AuditEntry
from crowd.audit.services import COMMAND_LINE
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion

SERVER_START = "start of the server"
# Not people: they may publish the fronts that ship, which were reviewed with the software.
PROGRAMS = frozenset({COMMAND_LINE, SERVER_START})
DRAFTED, REPLACED, SUBMITTED = "drafted", "draft replaced", "submitted for review"


class SecondPersonError(ValueError):
    """A publication by a person who drafted or submitted the content, or by an unknown person."""


def needed() -> bool:
    """Whether this deployment demands a second person."""
    return bool(settings.FRONTRUNNER_SECOND_PERSON)


def require(front: FrontVersion, by: str) -> None:
    """Raise SecondPersonError where BY may not publish the content of FRONT."""
    if not needed():
        return
    if by in PROGRAMS:
        if front.digest not in _shipped():
            raise SecondPersonError(
                f"{front.slug} needs a second person (FRONTRUNNER_SECOND_PERSON=1), and the command line "
                "does not say who you are: publish it in the administration"
            )
    elif by in authors(front):
        raise SecondPersonError(
            f"{by} drafted or submitted {front.slug}: another person must publish it "
            "(FRONTRUNNER_SECOND_PERSON=1)"
        )


def authors(front: FrontVersion) -> set[str]:
    """Everybody who drafted or submitted the content that FRONT has now."""
    entries = AuditEntry.objects.filter(
        subject=front.slug, digest=front.digest, action__in=(DRAFTED, REPLACED, SUBMITTED)
    )
    return set(entries.values_list("actor", flat=True))


def _shipped() -> set[str]:
    """Digests of the fronts in the folder that ships with the software."""
    found = set()
    for path in Path(settings.FRONTRUNNER_FRONTS).glob("*.json"):
        with suppress(front_file.InvalidFrontError):
            document = front_file.read(path)
            front_file.check(document)
            found.add(front_file.digest(document))
    return found
