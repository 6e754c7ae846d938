"""manage.py check_public: what is to do before strangers use the server."""

from typing import Any

from django.core.management.base import BaseCommand, CommandError

from crowd.operations.public import checks
from crowd.operations.public.line import Answer

WIDTH = max(len(answer) for answer in Answer) + 2


class Command(BaseCommand):
    help = "Look at settings, accounts and the running service; exit code 1 while something is to do."
    # Django's own checks are one line of the list.
    requires_system_checks = []

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        found = checks.lines()
        for line in found:
            self.stdout.write(f"{line.answer:<{WIDTH}}{line.title}: {line.finding}")
            if line.remedy:
                self.stdout.write(f"{'':<{WIDTH}}  -> {line.remedy}")
        counts = checks.counts(found)
        self.stdout.write(", ".join(f"{count} {answer}" for answer, count in counts.items()))
        if counts[Answer.TO_DO]:
            raise CommandError(f"{counts[Answer.TO_DO]} to do before the server is public")
