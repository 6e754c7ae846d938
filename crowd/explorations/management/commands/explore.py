"""manage.py explore: run a whole exploration on this machine, and write its front to a file."""

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
        "Search a space on this machine, measure the known configurations, repeat the best points, and "
        "write the front. The same command continues after an interruption."
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
        self.stdout.write(f"Continuing {found}")
        if found.state == Exploration.State.PAUSED:
            with transaction.atomic():
                services.resume(found)
                steering.log_step(found, COMMAND_LINE, "resumed", Exploration.State.PAUSED)
        reaping.reap_after_restart()
        return found

    def _created(self, application: str, options: dict[str, Any]) -> Exploration:
        with transaction.atomic():
            device = first_run.create_this_machine()
            reference_devices.change_device(device, None, options["device"])
            exploration = services.create(exploration_from(options, device, application))
            steering.log_step(exploration, COMMAND_LINE, "started", "", str(exploration))
            return exploration

    def _measure_here(self, exploration: Exploration) -> None:
        """Measure until the exploration is done. Workers of a running server may help.

        Raises CommandError if it is paused or cancelled, and CannotMeasureHereError.
        """
        printed = timezone.now()
        while exploration.state == Exploration.State.RUNNING:
            waiting = services.pending_evaluations(exploration) or services.advance(exploration.pk)
            for evaluation in waiting:
                _measure(evaluation)
                printed = self._print_finished(exploration, since=printed)
            if not waiting and services.unfinished_evaluations(exploration).exists():
                time.sleep(LOOK_AGAIN_SECONDS)  # another worker measures
                reaping.reap()
            printed = self._print_finished(exploration, since=printed)
            exploration.refresh_from_db()
        if exploration.state != Exploration.State.DONE:
            why = f" ({exploration.note})" if exploration.note else ""
            raise CommandError(f"{exploration} is {exploration.state}{why}: no front was written")

    def _print_finished(self, exploration: Exploration, since: datetime) -> datetime:
        """Print a line about each evaluation finished after SINCE. Returns when the last one finished."""
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
