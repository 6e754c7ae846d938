"""Whether measurements are taken now, and from which programs: settings, unless an administrator decided."""

from dataclasses import dataclass

from django.conf import settings

from crowd.database.prepared import CompiledQuery
from crowd.fronts.models import IntakePolicy


@dataclass(frozen=True)
class Policy:
    """What clients learn besides the front. `message` is for people, empty where there is none."""

    accepting: bool
    message: str
    minimum_app_version: str
    consent_version: int

    def outdates(self, app_version: str) -> bool:
        """Whether APP_VERSION is older than the minimum; what follows - or + is left aside.

        Raises ValueError for what is not a version.
        """
        return _numbers(app_version) < _numbers(self.minimum_app_version)


def current() -> Policy:
    """What holds at this moment, in every process. One query."""
    accepting, message, minimum = next(iter(_decided.rows()), (None, "", ""))
    return Policy(
        accepting=settings.FRONTRUNNER_ACCEPTING if accepting is None else accepting,
        message=message,
        minimum_app_version=minimum or settings.FRONTRUNNER_MINIMUM_APP_VERSION,
        consent_version=settings.FRONTRUNNER_CONSENT_VERSION,
    )


_decided = CompiledQuery(
    lambda: IntakePolicy.objects.values_list("accepting", "message", "minimum_app_version")
)


def _numbers(version: str) -> tuple[int, ...]:
    """1.2.0-beta is (1, 2): zeros at the end say nothing."""
    numbers = [int(part) for part in version.split("+")[0].split("-")[0].split(".")]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)
