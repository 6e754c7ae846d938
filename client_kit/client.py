"""The client for other programs: the same verbs as on the command line, with values instead of lines."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from client_kit.console import Console, Silence
from client_kit.delivery import enrolment, sending
from client_kit.delivery.manifest import Manifest, kept_manifests
from client_kit.delivery.sending import Delivery
from client_kit.delivery.server import Server, ServerError
from client_kit.delivery.spool import Item, Spool
from client_kit.errors import OutdatedError, UsageError
from client_kit.home import Home
from frontrunner.folders import user_folder
from slam.protocol import VALID_BELOW

if TYPE_CHECKING:
    from client_kit.choice import Point, Prediction
    from client_kit.participating.session_recorder import Measured

# What `send(wait=True)` sleeps at most before it looks again: clocks may be set meanwhile.
LONGEST_SLEEP_SECONDS = 60.0


class Client:
    """One installation: its folder, the servers it knows, what it measured.

    `server` is needed to measure and, where several servers were visited, to choose. `home` is the folder
    that keeps everything (the user's own, or FRONTRUNNER_HOME, where it is None). `console` is told of
    progress; None is silent. Methods raise ClientError, whose text is for people.
    """

    def __init__(
        self, server: str | None = None, home: Path | None = None, console: Console | None = None
    ) -> None:
        self.server = None if server is None else Server(server).url
        self.console = console or Console(Silence())
        self.home = Home(home or user_folder())
        self.home.prepare()

    @property
    def spool(self) -> Spool:
        """The sessions on this device."""
        return Spool(self.home.spool)

    def consent_text(
        self, device: str | None = None, application: str | None = None, backend: str | None = None
    ) -> str | None:
        """What the participant has to agree to before `run`; None where that was done before."""
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
        minutes: float | None = None,
        show_model: bool | None = None,
        application: str | None = None,
        backend: str | None = None,
        probes: bool | None = None,
    ) -> "list[Measured]":
        """Measure and send. `agree` says that the participant has read the consent text and agrees; the
        other arguments are those of `participation.Wishes`. A session of probes is the last one."""
        from client_kit.participating.participation import Wishes, run

        wishes = Wishes(
            self._server(),
            yes=agree,
            sessions=sessions,
            configurations=tuple(configurations),
            device=device,
            ignored=tuple(ignore),
            minutes=minutes,
            show_model=show_model,
            application=application,
            backend=backend,
            probes=probes,
        )
        return run(wishes, self.home, self.console)

    def status(self) -> list[Item]:
        """Every session that was measured here, oldest first, with its state and the server's reason; then
        those that are in progress or were killed."""
        spool = self.spool
        return spool.items() + spool.drafts()

    def send(self, *, wait: bool = False, pause: Callable[[float], None] = time.sleep) -> Delivery:
        """Send what waits; with `wait`, go on with pauses until nothing waits. The last pass is returned.

        Raises OutdatedError when a server refuses this version: its sessions stay.
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
        """Everything that is kept here and, of this installation, on the servers."""
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
        for known in enrolment.known(self.home):
            # A folder that several devices share has several installations on one server.
            name = known.server if known.server not in remote else f"{known.server} {known.installation_id}"
            try:
                remote[name] = Server(known.server).own_data(known.token)
            except (ServerError, OutdatedError) as error:
                remote[name] = {"unavailable": str(error)}
        return {"here": local, "servers": remote}

    def erase(self) -> bool:
        """Erase what is kept here and on the servers; False where a server could not be told yet.

        The request is kept then, and goes with the next `run` or `send`. A process that is sending is
        waited for; one that measures will keep and send nothing.
        """
        sessions, servers = sending.erase(self.spool, self.home)
        self.console.say(f"Erased {sessions} sessions here.")
        delivered = sending.deliver(self.spool, self.home)
        self.console.lines(delivered.lines())
        return len(delivered.erased) == len(servers)

    def erase_run(self, run: str) -> list[str]:
        """Erase the run of that id, or page's address, here and on the servers that have it: those.

        Raises UsageError where nobody has it, ServerError, and nothing is erased here, where a server
        cannot be asked.
        """
        return sending.erase_run(self.spool, self.home, run)

    def renew_tokens(self) -> list[str]:
        """Have the servers replace the tokens by which they know this client; those servers.

        Raises ServerError or OutdatedError after the last one where some could not be asked.
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
        `max_ate` metres or, with a time `max_ms` a frame that is enough, the most accurate within both.

        For what was not measured here the server is asked what it predicts; without an answer the reference
        device's times are scaled.
        """
        from client_kit import choice

        server, front = self._kept_front(application)
        measured = self._measured_on(device)
        # The server knows the device that was measured last by this client's token.
        is_last = measured[-1:] == self._measured_on(None)[-1:]
        predictions = self._predictions(server, front) if measured and is_last else []
        known = choice.points(front, measured, predictions)
        return choice.choose(known, max_ate, None if max_ms is None else max_ms / 1000)

    def chosen_device(self, device: str | None = None) -> tuple[str, str] | None:
        """Name and platform of the device whose measurements `choose` goes by, None without any."""
        from client_kit import choice

        measured = self._measured_on(device)
        return choice.device_of(measured[-1]) if measured else None

    def front(self, application: str | None = None) -> Manifest:
        """The published front as of the last visit. Raises UsageError where there is none, or several."""
        return self._kept_front(application)[1]

    def _kept_front(self, application: str | None) -> tuple[str, Manifest]:
        """The address of the server whose front that is, and the front."""
        manifests = {
            (url, name): kept
            for (url, name), kept in kept_manifests(self.home).items()
            if self.server in (None, url) and application in (None, name)
        }
        if not manifests:
            what = "no published front" if application is None else f"no published front of {application}"
            raise UsageError(f"{what} is kept here: run the client against a server first")
        servers, applications = (sorted(set(named)) for named in zip(*manifests, strict=True))
        if len(servers) > 1:
            raise UsageError(f"several servers were visited, name one (--server): {', '.join(servers)}")
        if len(applications) > 1:
            names = ", ".join(applications)
            raise UsageError(f"several applications were measured, name one (--application): {names}")
        [((server, _), manifest)] = manifests.items()
        return server, manifest

    def _predictions(self, address: str, front: Manifest) -> "list[Prediction]":
        """What the server predicts for this device, whatever the limits; nothing where it does not answer."""
        from client_kit import choice

        server = Server(address)
        token = enrolment.present(self.home, server)
        try:
            return choice.predictions(server.recommendation(front.application, token))
        except (ServerError, OutdatedError):
            return []

    def _measured_on(self, device: str | None) -> list[Mapping[str, Any]]:
        from client_kit import choice

        spool = self.spool
        payloads = (payload for item in spool.items() if (payload := spool.payload(item)) is not None)
        return choice.of_one_device(payloads, device)

    def _server(self) -> str:
        if self.server is None:
            raise UsageError("no server is named: give its address")
        return self.server
