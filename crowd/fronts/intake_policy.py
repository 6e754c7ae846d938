"""Whether measurements are accepted, and from which client versions: an administrator decides."""

from dataclasses import dataclass, replace

from django.conf import settings

from crowd.database.prepared import CompiledQuery
from crowd.demo import mark
from crowd.fronts.models import IntakePolicy
from groundwork import __version__

OLDEST = "0.1.0"  # the first version of a client


@dataclass(frozen=True)
class Policy:
    """The current policy. `message` is for people, and may be empty."""

    accepting: bool
    message: str
    minimum_app_version: str
    consent_version: int

    def is_outdated(self, app_version: str) -> bool:
        """Whether `app_version` is older than the minimum; suffixes after - or + are ignored.

        Raises ValueError if it is not a version.
        """
        return _numbers(app_version) < _numbers(self.minimum_app_version)

    def takes(self, app_version: str) -> bool:
        """Whether `app_version` is a version from the minimum to this program's own."""
        try:
            return _numbers(self.minimum_app_version) <= _numbers(app_version) <= _numbers(__version__)
        except ValueError:
            return False

    def at_least(self, app_version: str) -> "Policy":
        """This policy with `app_version` as the minimum, if that is newer. Raises ValueError as above."""
        if _numbers(app_version) <= _numbers(self.minimum_app_version):
            return self
        return replace(self, minimum_app_version=app_version)


def current() -> Policy:
    """The policy that applies now: a demo server accepts nothing. One query."""
    accepting, message, minimum = next(iter(_stored.rows()), (True, "", ""))
    if mark.refuses_clients():
        accepting, message = False, mark.REFUSAL
    return Policy(
        accepting=accepting,
        message=message,
        minimum_app_version=minimum or OLDEST,
        consent_version=settings.FRONTRUNNER_CONSENT_VERSION,
    )


_stored = CompiledQuery(
    lambda: IntakePolicy.objects.values_list("accepting", "message", "minimum_app_version")
)


def _numbers(version: str) -> tuple[int, ...]:
    """The numbers of `version` without trailing zeros: 1.2.0-beta is (1, 2)."""
    numbers = [int(part) for part in version.split("+")[0].split("-")[0].split(".")]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)
