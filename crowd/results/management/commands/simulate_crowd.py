"""manage.py simulate_crowd: a labelled crowd that nobody is, for trying the pages and for load."""

from contextlib import nullcontext
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser
from django.utils import timezone

from crowd.devices import permits
from crowd.results.figures import recomputing
from crowd.results.simulation import removing, sending

EACH = 10


class Command(BaseCommand):
    help = (
        "Send made-up sessions of simulated devices through the API. Pages show them with ?simulated=1 "
        "alone, labelled; nothing of them enters other figures or the open data."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("--devices", type=int, default=83, help="how many device models (83)")
        parser.add_argument("--sessions", type=int, default=5, help="sessions of each (5)")
        parser.add_argument("--seed", type=int, default=0, help="another seed, another crowd (0)")
        parser.add_argument("--application", default="kfusion")
        parser.add_argument("--server", metavar="URL", help="a server elsewhere; else this deployment itself")
        parser.add_argument("--permit-text", metavar="TEXT", help="with --server: what its --permit printed")
        only = parser.add_mutually_exclusive_group()
        only.add_argument(
            "--permit", action="store_true", help="print a permit for a day, and do nothing else"
        )
        only.add_argument("--remove", action="store_true", help="take the whole simulated crowd away again")

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        if options["permit"]:
            self.stdout.write(permits.issue())
        elif options["remove"]:
            self._remove()
        else:
            self._send(**options)

    def _send(self, devices: int, sessions: int, seed: int, server: str | None, **options: Any) -> None:
        if min(devices, sessions) < 1 or seed < 0:
            raise CommandError("give 1 or more devices, 1 or more sessions, and a seed of 0 or more")
        if server and not options["permit_text"]:
            raise CommandError("--server needs --permit-text: run simulate_crowd --permit there")
        carry = sending.over_http(server) if server else sending.in_process()
        crowd = sending.send_crowd(
            carry,
            options["permit_text"] or permits.permit(),
            devices,
            sessions,
            seed,
            timezone.now(),
            options["application"],
        )
        try:
            with nullcontext() if server else sending.unlimited():
                for done in crowd:
                    if done.devices % EACH == 0 or done.devices == devices:
                        self.stdout.write(
                            f"{done.devices} of {devices} devices, {done.sessions} sessions, {done.runs} runs"
                        )
        except sending.RefusedError as error:
            raise CommandError(str(error)) from error
        if not server:
            recomputing.work(lambda _done: None)
            self.stdout.write("all of it is summarised: see the pages with ?simulated=1")

    def _remove(self) -> None:
        gone = removing.remove_crowd()
        self.stdout.write(
            f"{gone.devices} simulated devices are gone, with {gone.sessions} sessions of "
            f"{gone.installations} installations"
        )
