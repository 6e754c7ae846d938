"""manage.py explore: run a whole exploration on this machine, and write its front as a file that ships."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError
from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd import first_run
from crowd.explorations import leases, publishing, services
from crowd.explorations.measurement import evaluator
from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts import contents
from pareto.errors import ParetoError
from pareto.methods import DEFAULT, METHODS
from pareto.space import Space


class Command(BaseCommand):
    help = (
        "Search a space on this machine, measure the known configurations too, measure the best again, and "
        "write the front. The same command goes on where an interrupted one ended."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("--space", type=Path, required=True, metavar="FILE")
        parser.add_argument("--sequence", type=Path, required=True, metavar="PACK", help="a pack's folder")
        parser.add_argument("--budget", type=int, required=True, help="configurations to search")
        parser.add_argument("--seed", type=int, default=0)
        parser.add_argument("--method", choices=list(METHODS), default=DEFAULT)
        parser.add_argument("--batch", type=int, default=8)
        parser.add_argument(
            "--points", type=int, default=12, help="of the front, to measure again and publish"
        )
        parser.add_argument("--repeats", type=int, default=3, help="further measurements of each such point")
        parser.add_argument(
            "--device", default="", metavar="TEXT", help="a part of an OpenCL device's description"
        )
        parser.add_argument(
            "--out", type=Path, required=True, metavar="FILE", help="<application>-<version>.json"
        )

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        application, _, version = options["out"].stem.rpartition("-")
        if not application or not version or options["out"].suffix != ".json":
            raise CommandError(f"--out {options['out']}: name it <application>-<version>.json")
        if not options["out"].parent.is_dir():
            raise CommandError(f"--out {options['out']}: there is no folder {options['out'].parent}")
        first_run.migrate()
        exploration = self._unfinished() or self._create(application, options)
        self._run(exploration)
        exploration.refresh_from_db()
        try:
            document = publishing.document(exploration, version)
            contents.check(document)
        except (publishing.NothingToPublishError, contents.InvalidFrontError) as error:
            raise CommandError(f"{exploration}: {error}") from error
        options["out"].write_text(json.dumps(document, indent=2) + "\n")
        self.stdout.write(f"{len(document['configurations'])} points: {options['out']}")

    def _command_line(self) -> str:
        return f"python manage.py {shlex.join(sys.argv[1:])}"

    def _unfinished(self) -> Exploration | None:
        found = Exploration.objects.filter(
            command=self._command_line(), state=Exploration.State.RUNNING
        ).first()
        if found is not None:
            # Whoever ran it is gone: nobody but this command measures on this machine's behalf.
            found.evaluations.filter(state=Evaluation.State.RUNNING).update(
                state=Evaluation.State.PENDING, lease_until=None
            )
            self.stdout.write(f"Going on with {found}")
        return found

    def _create(self, application: str, options: dict[str, Any]) -> Exploration:
        try:
            space = Space.load(options["space"])
            pack = json.loads((options["sequence"] / "pack.json").read_text())
        except (ParetoError, OSError, ValueError) as error:
            raise CommandError(str(error)) from error
        device = first_run.create_this_machine()
        if device.opencl_device != options["device"]:
            device.opencl_device = options["device"]
            device.save()
        exploration = Exploration(
            application=application,
            space=space.to_dict(),
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["ate_max", "runtime"],
            limits={"ate_max": publishing.MAX_ATE},
            method=options["method"],
            seed=options["seed"],
            budget=options["budget"],
            batch=options["batch"],
            points=options["points"],
            repeats=options["repeats"],
            command=self._command_line(),
        )
        try:
            return services.create(exploration)
        except ValidationError as error:
            raise CommandError("; ".join(error.messages)) from error

    def _run(self, exploration: Exploration) -> None:
        while waiting := services.waiting(exploration) or services.advance(exploration.pk):
            for evaluation in waiting:
                self._measure(evaluation)

    def _measure(self, waiting: Evaluation) -> None:
        with leases.leased(waiting.pk) as evaluation:
            if evaluation is not None:
                leases.record(evaluation, evaluator()(evaluation, lambda: leases.renew(evaluation)))
        waiting.refresh_from_db()
        self.stdout.write(f"{waiting.number:4} {waiting.phase:7} {waiting.label:9}{self._outcome(waiting)}")
        self.stdout.flush()

    def _outcome(self, evaluation: Evaluation) -> str:
        if evaluation.objectives is None:
            return f" failed: {evaluation.error}"
        runtime, error = evaluation.objectives["runtime"], evaluation.objectives["ate_max"]
        mark = "" if error < publishing.MAX_ATE else "  not valid"
        return f"{1e3 * runtime:9.2f} ms a frame {1e3 * error:8.1f} mm{mark}"
