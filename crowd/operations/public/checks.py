"""The whole check list, in the order in which it is read."""

from crowd.operations.public import configuration, people, service
from crowd.operations.public.line import Answer, Line


def lines() -> list[Line]:
    """Every line; what is to do stands first, what passed last."""
    found = [*configuration.lines(), *people.lines(), *service.lines()]
    order = [Answer.TO_DO, Answer.UNKNOWN, Answer.PASSED]
    return sorted(found, key=lambda line: order.index(line.answer))


def counts(found: list[Line]) -> dict[str, int]:
    """How many lines have each answer."""
    return {answer.value: sum(line.answer is answer for line in found) for answer in Answer}
