"""manage.py check_public: checks before strangers use the server."""

from typing import Any

from django.core.management.base import BaseCommand, CommandError

from crowd.operations.public import checks
from crowd.operations.public.check_result import Answer

WIDTH = max(len(answer) for answer in Answer) + 2


class Command(BaseCommand):
    help = "Check settings, accounts and the running service; exit code 1 while something is to do."

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        results = checks.run()
        for result in results:
            self.stdout.write(f"{result.answer:<{WIDTH}}{result.title}: {result.finding}")
            if result.remedy:
                self.stdout.write(f"{'':<{WIDTH}}  -> {result.remedy}")
        counts = checks.counts(results)
        self.stdout.write(", ".join(f"{count} {answer}" for answer, count in counts.items()))
        if counts[Answer.TO_DO]:
            raise CommandError(f"{counts[Answer.TO_DO]} to do before the server is public")
