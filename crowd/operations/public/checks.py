"""All checks, ordered by outcome."""

from crowd.operations.public import configuration, people, service
from crowd.operations.public.check_result import Answer, CheckResult


def run() -> list[CheckResult]:
    """The results of all checks: first what is to do, last what passed."""
    results = [*configuration.run(), *people.run(), *service.run()]
    order = [Answer.TO_DO, Answer.UNKNOWN, Answer.PASSED]
    return sorted(results, key=lambda result: order.index(result.answer))


def counts(found: list[CheckResult]) -> dict[str, int]:
    """The number of results by answer."""
    return {answer.value: sum(result.answer is answer for result in found) for answer in Answer}
