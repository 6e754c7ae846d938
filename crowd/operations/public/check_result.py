"""The result of one check."""

from dataclasses import dataclass
from enum import StrEnum


class Answer(StrEnum):
    """The possible outcomes of a check."""

    PASSED = "passed"
    TO_DO = "to do"
    UNKNOWN = "cannot be known"


@dataclass(frozen=True)
class CheckResult:
    """What a check found. `remedy` says what to do; for a passed check it is advice, and may be empty.

    `confirms` names the confirmation that a person can give; empty if the program can check by itself.
    """

    title: str
    answer: Answer
    finding: str
    remedy: str = ""
    confirms: str = ""


def passed(title: str, finding: str, advice: str = "") -> CheckResult:
    """The result of a check that passed."""
    return CheckResult(title, Answer.PASSED, finding, advice)


def to_do(title: str, finding: str, remedy: str, confirms: str = "") -> CheckResult:
    """The result of a check that needs action."""
    return CheckResult(title, Answer.TO_DO, finding, remedy, confirms)


def unknown(title: str, finding: str, remedy: str) -> CheckResult:
    """The result of a check that only a person can make."""
    return CheckResult(title, Answer.UNKNOWN, finding, remedy)
