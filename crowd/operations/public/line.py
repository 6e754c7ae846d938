"""One line of the check list: what was looked at, what was found, what to do."""

from dataclasses import dataclass
from enum import StrEnum


class Answer(StrEnum):
    """What a check can find."""

    PASSED = "passed"
    TO_DO = "to do"
    UNKNOWN = "cannot be known"


@dataclass(frozen=True)
class Line:
    """A check's answer. `remedy` says what to do; of what passed it is advice, and may be empty.

    `confirms` names the confirmation that a person can give; empty where the program sees for itself.
    """

    title: str
    answer: Answer
    finding: str
    remedy: str = ""
    confirms: str = ""


def passed(title: str, finding: str, advice: str = "") -> Line:
    """A line without anything to do."""
    return Line(title, Answer.PASSED, finding, advice)


def to_do(title: str, finding: str, remedy: str, confirms: str = "") -> Line:
    """A line with something to do."""
    return Line(title, Answer.TO_DO, finding, remedy, confirms)


def unknown(title: str, finding: str, remedy: str) -> Line:
    """A line for a person to look after: the program cannot."""
    return Line(title, Answer.UNKNOWN, finding, remedy)
