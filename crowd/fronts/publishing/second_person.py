"""Four-eyes rule: with FRONTRUNNER_SECOND_PERSON, authors of a front cannot publish it.

It also takes two people to retire one.

The audit log tells who drafted and who submitted the content, by its digest.
"""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from django.conf import settings
from django.db.models import OuterRef, QuerySet, Subquery

from crowd.audit.models import AuditEntry
from crowd.audit.services import COMMAND_LINE, account_id, record
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion

SERVER_START = "start of the server"
# Programs may publish the shipped fronts, which were reviewed with the software.
PROGRAMS = frozenset({COMMAND_LINE, SERVER_START})
DRAFTED, REPLACED, PREPARED = "drafted", "draft replaced", "prepared"
SUBMITTED = "submitted for review"
RETIREMENT_ASKED = "retirement asked"


class SecondPersonError(ValueError):
    """The publisher drafted or submitted the content, or is unknown."""


def is_required() -> bool:
    """Whether this server requires a second person."""
    return bool(settings.FRONTRUNNER_SECOND_PERSON)


def check(front: FrontVersion, by: str) -> None:
    """Raise SecondPersonError if `by` may not publish the content of `front`."""
    if not is_required():
        return
    if by in PROGRAMS:
        if front.digest not in _shipped():
            raise SecondPersonError(
                f"{front.slug} needs a second person (FRONTRUNNER_SECOND_PERSON=1), and the command line "
                "does not say who you are: publish it in the administration"
            )
    elif _people(_authorship(front)) & _names_of(by):
        raise SecondPersonError(
            f"{by} drafted or submitted {front.slug}: another person must publish it "
            "(FRONTRUNNER_SECOND_PERSON=1)"
        )


def check_retirement(front: FrontVersion, by: str) -> None:
    """Raise SecondPersonError if `by` may not retire `front`, or only asked for it now, which is logged."""
    if not is_required():
        return
    if by in PROGRAMS:
        raise SecondPersonError(
            f"retiring {front.slug} needs two people (FRONTRUNNER_SECOND_PERSON=1), and the command line "
            "does not say who you are: retire it in the administration"
        )
    asked = AuditEntry.objects.filter(subject=front.slug, digest=front.digest, action=RETIREMENT_ASKED)
    if any(not _people([entry]) & _names_of(by) for entry in asked):
        return
    if not asked:
        record(by, RETIREMENT_ASKED, front.slug, digest=front.digest, front_id=front.pk)
    raise SecondPersonError(
        f"{front.slug}: the log says that you ask to retire it; another person must retire it, too "
        "(FRONTRUNNER_SECOND_PERSON=1)"
    )


def last_author(front: FrontVersion) -> str:
    """Who drafted the current content of `front`, or replaced that of an earlier draft."""
    made = AuditEntry.objects.filter(subject=front.slug, action__in=(DRAFTED, REPLACED)).first()
    return COMMAND_LINE if made is None else made.actor


def offered() -> QuerySet[FrontVersion]:
    """The drafts whose current content a start of the server made of a shipped front. One query."""
    made = AuditEntry.objects.filter(subject=OuterRef("slug"), action__in=(DRAFTED, REPLACED))
    drafts = FrontVersion.objects.filter(state=FrontVersion.State.DRAFT)
    return drafts.annotate(author=Subquery(made.values("actor")[:1])).filter(author=SERVER_START)


def _authorship(front: FrontVersion) -> QuerySet[AuditEntry]:
    return AuditEntry.objects.filter(
        subject=front.slug, digest=front.digest, action__in=(DRAFTED, REPLACED, PREPARED, SUBMITTED)
    )


def _people(entries: Iterable[AuditEntry]) -> set[str | int | None]:
    """The names of those who made `entries`, without case, and the ids of their accounts."""
    return {each for entry in entries for each in (entry.actor.casefold(), entry.account)} - {None}


def _names_of(by: str) -> set[str | int | None]:
    """As `_people`, of the account `by`: it keeps its id where it is renamed."""
    return {by.casefold(), account_id(by)} - {None}


def _shipped() -> set[str]:
    """The digests of the shipped fronts."""
    digests = set()
    for path in Path(settings.FRONTRUNNER_FRONTS).glob("*.json"):
        with suppress(front_file.InvalidFrontError):
            digests.add(front_file.digest(front_file.check(front_file.read(path))))
    return digests
