"""manage.py simulate_crowd: a simulated, labelled crowd, to try the pages and to create load."""

from collections.abc import Iterator
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
        "Send simulated sessions of simulated devices through the API. Pages show them, labelled, only with "
        "?simulated=1. They never count in other figures or in the open data."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        parser.add_argument("--devices", type=int, default=83, help="how many device models (83)")
        parser.add_argument("--sessions", type=int, default=5, help="sessions of each (5)")
        parser.add_argument(
            "--probes",
            type=float,
            default=0.5,
            metavar="SHARE",
            help="share of the installations (0 to 1) that also measure probes (0.5)",
        )
        parser.add_argument("--seed", type=int, default=0, help="seed of the random numbers (0)")
        parser.add_argument("--application", default="kfusion")
        parser.add_argument("--server", metavar="URL", help="send to this server; default: this deployment")
        parser.add_argument(
            "--permit-text", metavar="TEXT", help="with --server: the permit that --permit printed there"
        )
        only = parser.add_mutually_exclusive_group()
        only.add_argument("--permit", action="store_true", help="only print a permit, valid for a day")
        only.add_argument("--remove", action="store_true", help="delete the simulated crowd")

    def handle(self, *args: Any, **options: Any) -> None:  # noqa: ARG002
        if options["permit"]:
            self.stdout.write(permits.issue())
        elif options["remove"]:
            self._remove()
        else:
            self._send(**options)

    def _send(
        self, devices: int, sessions: int, probes: float, seed: int, server: str | None, **options: Any
    ) -> None:
        if min(devices, sessions) < 1 or seed < 0:
            raise CommandError("--devices and --sessions must be 1 or more, --seed 0 or more")
        if not 0 <= probes <= 1:
            raise CommandError(f"--probes {probes:g}: give a share from 0 to 1")
        if server and not options["permit_text"]:
            raise CommandError("--server needs --permit-text: run simulate_crowd --permit there")
        carry = sending.over_http(server) if server else sending.in_process()
        permit = options["permit_text"] or permits.permit()
        try:
            with nullcontext() if server else sending.without_limits():
                crowd = sending.Crowd(carry, permit, devices, seed, timezone.now(), options["application"])
                self._follow(crowd.send(sessions), devices, "")
                if not server:
                    recomputing.recompute(lambda _done: None)
                if probes:
                    self._follow(crowd.send_probes(probes), devices, " of probes")
        except sending.RefusedError as error:
            raise CommandError(str(error)) from error
        if not server:
            recomputing.recompute(lambda _done: None)
            self.stdout.write("all sessions are summarised: see the pages with ?simulated=1")

    def _follow(self, progress: Iterator[sending.Progress], devices: int, kind: str) -> None:
        for done in progress:
            if done.devices % EACH == 0 or done.devices == devices:
                self.stdout.write(
                    f"{done.devices} of {devices} devices, {done.sessions} sessions{kind}, {done.runs} runs"
                )

    def _remove(self) -> None:
        gone = removing.remove_crowd()
        self.stdout.write(
            f"deleted {gone.devices} simulated devices with {gone.sessions} sessions of "
            f"{gone.installations} installations"
        )
