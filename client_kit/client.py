"""The client for other programs: the same commands as on the command line, returning values."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from client_kit.console import Console, NullStream
from client_kit.delivery import enrolment, sending
from client_kit.delivery.manifest import Manifest, stored_manifests
from client_kit.delivery.sending import Delivery
from client_kit.delivery.server import Server, ServerError
from client_kit.delivery.spool import Item, Spool
from client_kit.errors import OutdatedError, UsageError
from client_kit.home import Home
from client_kit.measuring.worker_client import COMPILING_MINUTES
from groundwork.folders import user_folder
from wire.protocol import VALID_BELOW
from wire.recommendation import Point as Prediction

if TYPE_CHECKING:
    from client_kit.choice import Point
    from client_kit.participating.session_recorder import Measured

# The longest sleep of `send(wait=True)` between two checks, since clocks may be set meanwhile.
LONGEST_SLEEP_SECONDS = 60.0


class Client:
    """One installation: its folder, its servers, its sessions.

    `server` is needed to measure and, where several servers were visited, to choose. `home` is the folder for
    everything (None: the user's, or FRONTRUNNER_HOME). `console` shows progress; None is silent. Methods
    raise ClientError, whose text is for people.
    """

    def __init__(
        self, server: str | None = None, home: Path | None = None, console: Console | None = None
    ) -> None:
        self.server = None if server is None else Server(server).url
        self.console = console or Console(NullStream())
        self.home = Home(home or user_folder())
        self.home.prepare()

    @property
    def spool(self) -> Spool:
        """The sessions on this device."""
        return Spool(self.home.spool)

    def consent_text(
        self, device: str | None = None, application: str | None = None, backend: str | None = None
    ) -> str | None:
        """The consent text to agree to before `run`; None if already agreed."""
        from client_kit.participating import participation

        return participation.consent_text(self._server(), self.home, device, application, backend)

    def run(
        self,
        *,
        agree: bool = False,
        sessions: int = 1,
        configurations: Sequence[str] = (),
        device: str | None = None,
        ignore: Sequence[str] = (),
        show_model: bool | None = None,
        application: str | None = None,
        backend: str | None = None,
        probes: bool | None = None,
        compiling_minutes: int = COMPILING_MINUTES,
    ) -> "list[Measured]":
        """Measure and send. `agree`: the participant has read the consent text and agrees; the
        other arguments are those of `participation.RunOptions`. A session of probes is the last one."""
        from client_kit.participating.participation import RunOptions, run

        options = RunOptions(
            self._server(),
            yes=agree,
            sessions=sessions,
            configurations=tuple(configurations),
            device=device,
            ignored=tuple(ignore),
            show_model=show_model,
            application=application,
            backend=backend,
            probes=probes,
            compiling_minutes=compiling_minutes,
        )
        return run(options, self.home, self.console)

    def status(self) -> list[Item]:
        """Every session of this device, oldest first, with its state and the server's reason; then those in
        progress or killed."""
        spool = self.spool
        return spool.items() + spool.drafts()

    def send(self, *, wait: bool = False, pause: Callable[[float], None] = time.sleep) -> Delivery:
        """Send waiting sessions; with `wait`, repeat with pauses until none waits. Returns the last pass.

        Raises OutdatedError when a server refuses this version: its sessions stay queued.
        """
        spool = self.spool
        delivered = sending.deliver(spool, self.home)
        self.console.lines(delivered.lines())
        while wait and delivered.outdated is None and (waiting := sending.waiting(spool)):
            due = min(sending.pauses(waiting, time.time()).values())
            seconds = min(max(due, 1.0), LONGEST_SLEEP_SECONDS)
            self.console.say(f"{len(waiting)} to send; next attempt in {max(due, 1.0):.0f} s")
            pause(seconds)
            delivered = sending.deliver(spool, self.home, eager=False)
            self.console.lines(delivered.lines())
        if delivered.outdated is not None:
            raise delivered.outdated
        return delivered

    def export(self) -> dict[str, Any]:
        """All data of this installation, here and on the servers."""
        spool = self.spool
        local = [
            {
                "state": item.state,
                "reason": item.reason,
                "server": item.server,
                "payload": spool.payload(item),
            }
            for item in self.status()
        ]
        remote: dict[str, Any] = {}
        for enrolled in enrolment.all_enrolments(self.home):
            # A folder shared by several devices has several installations on one server.
            name = (
                enrolled.server
                if enrolled.server not in remote
                else f"{enrolled.server} {enrolled.installation_id}"
            )
            try:
                remote[name] = Server(enrolled.server).own_data(enrolled.token)
            except (ServerError, OutdatedError) as error:
                remote[name] = {"unavailable": str(error)}
        return {"here": local, "servers": remote}

    def erase(self) -> bool:
        """Erase all data here and on the servers; False where a server could not be reached yet.

        The request is then stored and sent by the next `run` or `send`. This waits for a process that is
        sending; one that is measuring will store and send nothing.
        """
        sessions, servers = sending.erase(self.spool, self.home)
        self.console.say(f"Erased {sessions} sessions here.")
        delivered = sending.deliver(self.spool, self.home)
        self.console.lines(delivered.lines())
        return len(delivered.erased) == len(servers)

    def erase_run(self, run: str) -> list[str]:
        """Erase the run with that id, or page address, here and on the servers that have it; return those.

        Raises UsageError where it is unknown. Raises ServerError, and erases nothing here, where a server
        cannot be reached.
        """
        return sending.erase_run(self.spool, self.home, run)

    def renew_tokens(self) -> list[str]:
        """Have the servers replace this client's tokens; return those servers.

        Raises ServerError or OutdatedError after the last one where some could not be reached.
        """

        def renewed(server: str) -> None:
            self.console.say(f"Replaced at {server}; the old token is void.")

        return sending.renew_tokens(self.home, renewed)

    def choose(
        self,
        max_ate: float = VALID_BELOW,
        max_ms: float | None = None,
        device: str | None = None,
        application: str | None = None,
    ) -> "Point":
        """The configuration to use on this device: the fastest whose largest trajectory error stays within
        `max_ate` metres or, with a limit `max_ms` a frame, the most accurate within both.

        For other configurations it asks the server for predictions; without an answer it scales the reference
        device's times.
        """
        from client_kit import choice

        server, front = self._kept_front(application)
        measured = self._measured_on(device)
        # The server identifies the device of the last session by this client's token.
        is_last = measured[-1:] == self._measured_on(None)[-1:]
        predictions = self._predictions(server, front) if measured and is_last else ()
        points = choice.points(front, measured, predictions)
        return choice.choose(points, max_ate, None if max_ms is None else max_ms / 1000)

    def chosen_device(self, device: str | None = None) -> tuple[str, str] | None:
        """Name and platform of the device whose measurements `choose` uses, None without any."""
        from client_kit import choice

        measured = self._measured_on(device)
        return choice.device_of(measured[-1]) if measured else None

    def front(self, application: str | None = None) -> Manifest:
        """The published front at the last visit. Raises UsageError unless there is exactly one."""
        return self._kept_front(application)[1]

    def _kept_front(self, application: str | None) -> tuple[str, Manifest]:
        """The address of the server whose front that is, and the front."""
        manifests = {
            (url, name): kept
            for (url, name), kept in stored_manifests(self.home).items()
            if self.server in (None, url) and application in (None, name)
        }
        if not manifests:
            what = "no published front" if application is None else f"no published front of {application}"
            raise UsageError(f"{what} is stored here: run the client against a server first")
        servers, applications = (sorted(set(named)) for named in zip(*manifests, strict=True))
        if len(servers) > 1:
            raise UsageError(f"several servers were visited, name one (--server): {', '.join(servers)}")
        if len(applications) > 1:
            names = ", ".join(applications)
            raise UsageError(f"several applications were measured, name one (--application): {names}")
        [((server, _), manifest)] = manifests.items()
        return server, manifest

    def _predictions(self, address: str, front: Manifest) -> tuple[Prediction, ...]:
        """The server's predictions for this device, without limits; empty where it does not answer."""
        from client_kit import choice

        server = Server(address)
        token = enrolment.current_token(self.home, server)
        try:
            return choice.predictions(server.recommendation(front.application, token))
        except (ServerError, OutdatedError):
            return ()

    def _measured_on(self, device: str | None) -> list[Mapping[str, Any]]:
        from client_kit import choice

        spool = self.spool
        payloads = (payload for item in spool.items() if (payload := spool.payload(item)) is not None)
        return choice.of_one_device(payloads, device)

    def _server(self) -> str:
        if self.server is None:
            raise UsageError("no server is named: give its address")
        return self.server
