"""manage.py results export | release | recompute: maintains the results by hand."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from crowd.audit.services import COMMAND_LINE
from crowd.http.problems import Problem
from crowd.results.figures import recomputing
from crowd.results.figures import sessions as session_figures
from crowd.results.opendata import exports, releases
from crowd.results.opendata.description_files import ordered_files


class Command(BaseCommand):
    help = "Write the open data now, or compute figures again. The worker does both automatically."

    def add_arguments(self, parser: CommandParser) -> None:
        actions = parser.add_subparsers(dest="action", required=True)
        actions.add_parser("export", help="write and publish an export of the open data")
        release = actions.add_parser("release", help="make an export a release, which stays and can be cited")
        release.add_argument("day", nargs="?", metavar="DAY", help="its day, as 2026-11-30; else the newest")
        recompute = actions.add_parser(
            "recompute",
            help="summarise waiting sessions; with an option, selected sessions again from their raw runs",
        )
        recompute.add_argument("--all", action="store_true", help="all sessions")
        recompute.add_argument("--device", metavar="SLUG", help="sessions of this device")
        recompute.add_argument("--front", metavar="VERSION", help="sessions of this front, such as kfusion-1")
        recompute.add_argument(
            "--part",
            type=_part,
            metavar="K/N",
            help="only summarise part K of N, beside processes for the others; then run it without --part",
        )

    def handle(self, *args: Any, action: str, **options: Any) -> None:  # noqa: ARG002
        actions: dict[str, Callable[..., None]] = {
            "export": self._export,
            "release": self._release,
            "recompute": self._recompute,
        }
        actions[action](**options)

    def _recompute(
        self, device: str | None, front: str | None, part: session_figures.Part | None, **options: Any
    ) -> None:
        if options["all"] or device is not None or front is not None:
            selected = session_figures.sessions_of(part, recomputing.select_sessions(device, front))
            marked = session_figures.mark_for_summary(selected)
            self.stdout.write(f"{marked} sessions to summarise again")
            if not marked and not options["all"]:
                raise CommandError("no session matches --device and --front: check their spelling")
        sessions, cohorts = recomputing.recompute(
            lambda done: self.stdout.write(f"{done} sessions summarised"), part
        )
        self.stdout.write(f"{sessions} sessions summarised in all, figures of {cohorts} cohorts computed")

    def _export(self, **options: Any) -> None:  # noqa: ARG002
        try:
            export = exports.create_export()
        except exports.AbandonedError as error:
            raise CommandError(
                "another process deleted each attempt, as it made no progress for "
                f"{exports.ABANDONED_AFTER.total_seconds() / 60:.0f} minutes: run it again"
            ) from error
        for file in ordered_files(export):
            rows = "" if file.stored.rows is None else f"{file.stored.rows} rows, "
            self.stdout.write(f"/data/{export.name}/{file.name}: {rows}{file.stored.bytes} bytes")

    def _release(self, day: str | None, **options: Any) -> None:  # noqa: ARG002
        try:
            export = releases.find_export(day) if day else releases.newest_day()
            releases.make_release(export, COMMAND_LINE)
        except (Problem, releases.ReleaseError) as error:
            raise CommandError(str(error)) from error
        self.stdout.write(f"/data/{export.name}/ is a release now")


def _part(text: str) -> session_figures.Part:
    """The part that `text` names, such as 1/4."""
    number, slash, count = text.partition("/")
    if slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count):
        return session_figures.Part(int(number), int(count))
    raise ArgumentTypeError(f"{text!r} is not a part: write 1/4 to 4/4 for four processes")
