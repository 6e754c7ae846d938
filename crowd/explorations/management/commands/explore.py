"""manage.py explore: run a whole exploration on this machine, and write its front to a file."""

from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django.db import transaction

from crowd.audit.services import COMMAND_LINE
from crowd.database.upgrade import migrate
from crowd.explorations import services, steering
from crowd.explorations.management import files
from crowd.explorations.management.cli_options import add_exploration_options, command_line, exploration_from
from crowd.explorations.management.measuring_here import measure_here
from crowd.explorations.measuring import reaping, reference_devices
from crowd.explorations.models import Exploration
from crowd.explorations.outcomes import publishing


class Command(BaseCommand):
    help = (
        "Search a space on this machine, measure the known configurations, repeat the best points, prepare "
        "them for clients, and write the front. The same command continues after an interruption."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        add_exploration_options(parser)
        parser.add_argument(
            "--device", metavar="TEXT", help="part of an OpenCL device's description (default: unchanged)"
        )
        parser.add_argument(
            "--out", type=Path, required=True, metavar="FILE", help="<application>-<version>.json"
        )

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        application, _ = files.parse_front_name(options["out"])
        if options["repeats"] < publishing.LEAST_REPEATS:
            raise CommandError(
                f"--repeats {options['repeats']}: give {publishing.LEAST_REPEATS} or more to publish a front"
            )
        migrate()
        try:
            exploration = self._unfinished(options["out"]) or self._created(application, options)
            measure_here(exploration, self._say)
            draft = files.draft(exploration, options["out"])
            measure_here(steering.prepare(draft, COMMAND_LINE, exploration.reference_device), self._say)
        except ValidationError as error:
            raise CommandError("; ".join(error.messages)) from error
        self._say(files.write_draft(draft, options["out"]))

    def _unfinished(self, out: Path) -> Exploration | None:
        """The newest exploration by this command, unless it was cancelled or its front is written."""
        exploration = Exploration.objects.filter(command=command_line()).first()
        if exploration is None or exploration.state == Exploration.State.CANCELLED:
            return None
        if exploration.state == Exploration.State.DONE and out.exists():
            return None
        self._say(f"Continuing {exploration}")
        if exploration.state == Exploration.State.PAUSED:
            with transaction.atomic():
                services.resume(exploration)
                steering.log_step(exploration, COMMAND_LINE, "resumed", Exploration.State.PAUSED)
        reaping.reap_after_restart()
        return exploration

    def _created(self, application: str, options: dict[str, Any]) -> Exploration:
        with transaction.atomic():
            device = reference_devices.create_this_machine()
            reference_devices.change_device(device, None, options["device"])
            exploration = services.create(exploration_from(options, device, application), options["known"])
            steering.log_step(exploration, COMMAND_LINE, "started", "", str(exploration))
            return exploration

    def _say(self, line: str) -> None:
        self.stdout.write(line)
        self.stdout.flush()
