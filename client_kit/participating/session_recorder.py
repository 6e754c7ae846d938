"""Sessions on one device, from the first run to the server's answer: measured, stored, sent and shown."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from client_kit import interrupts
from client_kit.console import Console
from client_kit.delivery import consent, reference_trajectories, sending
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import Server
from client_kit.delivery.spool import ACCEPTED, DUPLICATE, Item, Spool
from client_kit.device import preflight
from client_kit.errors import CannotMeasureError
from client_kit.home import Home
from client_kit.measuring import measurement
from client_kit.measuring.measurement import Observer, Task
from client_kit.measuring.session import Run, Session, payload
from client_kit.participating import result_pages, summary
from slam.definitions import SYSTEMS
from slam.devices.device import Device

WITHDRAWN = "your agreement was withdrawn meanwhile: the measurement is not stored"
CONTENTION = "Another program used this processor while we measured. Measuring again."


@dataclass(frozen=True)
class Measured:
    """A measured session, and its entry in the spool."""

    session: Session
    item: Item

    @property
    def accepted(self) -> bool:
        """Whether the server has accepted it."""
        return self.item.state in (ACCEPTED, DUPLICATE)


@dataclass(frozen=True)
class SessionRecorder:
    """Records sessions of `device` for `server`. `identity` describes this machine, `show_model`: whether its
    model may be shown in public, `pause` waits. `compiling_minutes`: see `measurement.measure`."""

    server: Server
    home: Home
    spool: Spool
    console: Console
    device: Device
    identity: Mapping[str, str | None]
    show_model: bool | None
    pause: Callable[[float], None]
    root: Path
    compiling_minutes: int

    def record(
        self, path: Path, asked: Manifest, plan: tuple[str, ...], *, with_pages: bool = True
    ) -> Measured:
        """Measure `plan` over the sequence at `path`, send the session and show its result; `with_pages`:
        also its rank among others.

        Raises CannotMeasureError where nothing ran or the agreement was withdrawn, OutdatedError where a
        server refuses this version, and KeyboardInterrupt after finished runs are stored.
        """
        self.console.say(f"Order: {', '.join(plan)}, {asked.protocol.frames} frames each")
        done, interrupted, item = self._measured_and_kept(path, asked, plan)
        if interrupted:
            self.console.say(f"Stopped: the {len(done.runs)} finished runs are kept.")
            raise KeyboardInterrupt
        delivered = sending.deliver(self.spool, self.home)
        self.console.lines(summary.stages(done, asked))
        self.console.lines(summary.figures(done, asked))
        self.console.lines(delivered.lines())
        kept = self.spool.find(item.id)
        if kept is None:
            raise CannotMeasureError(WITHDRAWN)
        measured = Measured(done, kept)
        if with_pages and measured.accepted:
            result_pages.show(self.server, self.home, done, kept, asked, self.console, self.pause)
        if delivered.outdated is not None:
            raise delivered.outdated
        if all(one.status == "failed" for one in done.runs):
            raise CannotMeasureError(f"no configuration runs here: {done.runs[0].failure}")
        return measured

    def _measured_and_kept(
        self, path: Path, asked: Manifest, plan: tuple[str, ...]
    ) -> tuple[Session, bool, Item]:
        """The session of `plan`, stored for sending, and whether it was ended early. Meanwhile its finished
        runs are stored as a draft; the lock keeps other processes from sending the draft."""
        references = reference_trajectories.read(asked, self.home)
        task = Task(asked, plan, path, references, self._impossible(asked, plan))
        storing = StoringObserver(self, asked)
        with self.home.only_one("measurement") as alone:
            if not alone:
                raise CannotMeasureError("another client measures on this device: wait until it is done")
            done, interrupted = measurement.measure(
                task, self.device, storing, self.root, self.compiling_minutes
            )
            with interrupts.ignored():
                return done, interrupted, storing.store(done)

    def _impossible(self, asked: Manifest, plan: tuple[str, ...]) -> dict[str, str]:
        """The reasons of the configurations that this device cannot run."""
        planned = [asked.by_name[name] for name in plan]
        parameters = {configuration.name: configuration.parameters for configuration in planned}
        backends = {configuration.name: configuration.backends for configuration in planned}
        too_large = preflight.too_large(parameters, self.device, self.root)
        return too_large | preflight.unsupported(backends, self.device.backend)


@dataclass(frozen=True)
class StoringObserver(Observer):
    """Stores a session of `asked` while it is measured, and shows its progress."""

    recorder: SessionRecorder
    asked: Manifest

    def frame(self, label: str, done: int, total: int, left: float | None) -> None:
        self.recorder.console.bar(label, done, total, left=left)

    def run(self, run: Run) -> None:
        parameters = self.asked.by_name[run.configuration].parameters
        adapts = SYSTEMS[self.asked.application].skips(parameters)
        self.recorder.console.lines(summary.run_lines(run, self.asked, adapts))

    def session(self, session: Session) -> None:
        recorder = self.recorder
        recorder.spool.keep_draft(recorder.server.url, self._payload(session), self._require_agreement)

    def contention(self) -> None:
        self.recorder.console.say(CONTENTION)

    def rest(self, seconds: float) -> None:
        self.recorder.pause(seconds)

    def store(self, session: Session) -> Item:
        """Put the whole session into the spool."""
        recorder = self.recorder
        return recorder.spool.put(recorder.server.url, self._payload(session), self._require_agreement)

    def _payload(self, session: Session) -> dict[str, Any]:
        return payload(session, self.asked, self.recorder.identity, self.recorder.show_model)

    def _require_agreement(self) -> None:
        if not consent.is_agreed(self.recorder.home, self.recorder.server.url, self.asked.consent_version):
            raise CannotMeasureError(WITHDRAWN)
