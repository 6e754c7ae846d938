"""manage.py explore: run a whole exploration on this machine, and write its front as a file that ships."""

import time
from datetime import datetime
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser
from django.db import transaction
from django.utils import timezone

from crowd.audit.services import COMMAND_LINE
from crowd.explorations import services, steering
from crowd.explorations.management import files
from crowd.explorations.management.cli_options import add_exploration_options, command_line, exploration_from
from crowd.explorations.measuring import leases, reaping, reference_devices
from crowd.explorations.measuring.measurement import CannotMeasureHereError, evaluator
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.searching.search import FINISHED
from crowd.operations import first_run
from slam.protocol import VALID_BELOW

LOOK_AGAIN_SECONDS = 1.0


class Command(BaseCommand):
    help = (
        "Search a space on this machine, measure the known configurations too, measure the best again, and "
        "write the front. The same command goes on where an interrupted one ended."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        add_exploration_options(parser)
        parser.add_argument(
            "--device", metavar="TEXT", help="a part of an OpenCL device's description (as it was before)"
        )
        parser.add_argument(
            "--out", type=Path, required=True, metavar="FILE", help="<application>-<version>.json"
        )

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        application, _ = files.name_of(options["out"])
        if options["repeats"] < publishing.LEAST_REPEATS:
            raise CommandError(
                f"--repeats {options['repeats']}: a figure is published from {publishing.LEAST_REPEATS} on"
            )
        first_run.migrate()
        try:
            exploration = self._unfinished() or self._created(application, options)
            self._measure_here(exploration)
        except ValidationError as error:
            raise CommandError("; ".join(error.messages)) from error
        except CannotMeasureHereError as error:
            raise CommandError(str(error)) from error
        self.stdout.write(files.write_front(exploration, options["out"]))

    def _unfinished(self) -> Exploration | None:
        states = (Exploration.State.RUNNING, Exploration.State.PAUSED)
        found = Exploration.objects.filter(command=command_line(), state__in=states).first()
        if found is None:
            return None
        self.stdout.write(f"Going on with {found}")
        if found.state == Exploration.State.PAUSED:
            with transaction.atomic():
                services.resume(found)
                steering.log(found, COMMAND_LINE, "resumed", Exploration.State.PAUSED)
        reaping.reap_after_restart()
        return found

    def _created(self, application: str, options: dict[str, Any]) -> Exploration:
        with transaction.atomic():
            device = first_run.create_this_machine()
            reference_devices.change(device, None, options["device"])
            exploration = services.create(exploration_from(options, device, application))
            steering.log(exploration, COMMAND_LINE, "started", "", str(exploration))
            return exploration

    def _measure_here(self, exploration: Exploration) -> None:
        """Measure whatever waits until the exploration is done; workers of a running server may help.

        Raises CommandError where it is paused or cancelled: half an exploration has no front; and
        CannotMeasureHereError.
        """
        told = timezone.now()
        while exploration.state == Exploration.State.RUNNING:
            waiting = services.waiting(exploration) or services.advance(exploration.pk)
            for evaluation in waiting:
                _measure(evaluation)
                told = self._tell(exploration, since=told)
            if not waiting and services.unfinished_of(exploration).exists():
                time.sleep(LOOK_AGAIN_SECONDS)  # another worker measures
                reaping.reap()
            told = self._tell(exploration, since=told)
            exploration.refresh_from_db()
        if exploration.state != Exploration.State.DONE:
            why = f" ({exploration.note})" if exploration.note else ""
            raise CommandError(f"{exploration} is {exploration.state}{why}: no front was written")

    def _tell(self, exploration: Exploration, since: datetime) -> datetime:
        """A line about each evaluation that was finished SINCE then; when the last of them was."""
        rows = exploration.evaluations.filter(state__in=FINISHED, finished_at__gt=since)
        for row in rows.order_by("finished_at"):
            self.stdout.write(f"{row.number:4} {row.phase:7} {row.label:9}{_outcome(row)}")
            since = row.finished_at or since
        self.stdout.flush()
        return since


def _measure(waiting: Evaluation) -> None:
    with leases.leased(waiting.pk) as evaluation:
        if evaluation is not None:
            leases.record(evaluation, evaluator()(evaluation, lambda: leases.renew(evaluation)))


def _outcome(evaluation: Evaluation) -> str:
    if evaluation.objectives is None:
        return f" failed: {evaluation.error}"
    runtime, error = (evaluation.objectives.get(name, float("inf")) for name in ("runtime", "ate_max"))
    mark = "" if error < VALID_BELOW else "  not valid"
    least = ">=" if evaluation.censored else ""
    return f"{1e3 * runtime:9.2f} ms a frame {least + f'{1e3 * error:.1f}':>8} mm{mark}"
