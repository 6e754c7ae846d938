"""Serving as a reference device: lease an evaluation, measure it in its own process, report the result.

The server's state is authoritative. While it cannot be reached, a measurement goes on. Its result stays on
disk until the server accepts it or has ended the lease; a later process may report it.
"""

import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from client_kit import APP, interrupts
from client_kit.console import Console
from client_kit.delivery import sequences
from client_kit.delivery.server import NotFrontrunnerError, ProblemError, Server, UnreachableError
from client_kit.device import requirements, selection
from client_kit.errors import CannotMeasureError, ClientError, HomeError, UsageError
from client_kit.home import Home
from groundwork import __version__
from slam import isolated
from slam.isolated import (
    CannotMeasureHereError,
    LeaseLostError,
    Measurement,
    MeasurementError,
)
from slam.public_text import one_line
from wire.evaluation import Part, as_measured
from wire.lease import Lease, Result
from wire.manifest import Sequence

IDLE_SECONDS = 5.0
FIRST_PAUSE_SECONDS = 1.0
LONGEST_PAUSE_SECONDS = 60.0
GONE = 410
# The unreported result, by the address of the server and the name of the device there.
RESULTS = "results.json"


def read_lease(document: Mapping[str, Any]) -> Lease:
    """`document`, an answer of POST /leases, checked. Raises NotFrontrunnerError."""
    try:
        return msgspec.convert(document, Lease)
    except msgspec.ValidationError as error:
        raise NotFrontrunnerError(f"the lease cannot be read: {error}") from error


def serve(
    server: Server,
    device: str,
    token: str,
    home: Home,
    console: Console,
    until_idle: bool = False,
    backend: str | None = None,
    pause: Callable[[float], None] = time.sleep,
) -> None:
    """Measure the evaluations for `device` one after another, until Ctrl-C or, if wanted, until idle.

    Each lease names its backend; if `backend` is another one, nothing is measured. While another client
    measures from the same folder, this one requests nothing, since two measurements would disturb each other.
    The other client may measure whenever this one does not. Raises UsageError for a token that is not this
    device's. After returning the current evaluation, raises KeyboardInterrupt, CannotMeasureError where
    nothing can be measured here, and OutdatedError.
    """
    serve_as(ReferenceDevice(server, device, token, home, console, pause, backend), until_idle)


def serve_as(reference: "ReferenceDevice", until_idle: bool = False, idle: float = IDLE_SECONDS) -> None:
    """Serve as `reference`, which asks again `idle` seconds after nothing was waiting; else as `serve`."""
    home, console = reference.home, reference.console
    console.say(
        f"Serving {reference.server.url} as {reference.device}. "
        "Ctrl-C ends it and returns the current evaluation."
    )
    disturbed = False
    while True:
        with home.only_one("measurement") as alone:
            pass  # held while measuring, not while the server is polled
        if alone and reference.serve_next():
            continue
        if not alone and not disturbed:
            console.say("Another client measures on this device: waiting until it is done.")
        disturbed = not alone
        if alone and until_idle:
            console.say("Nothing waits.")
            return
        reference.pause(idle)


@dataclass(frozen=True)
class ReferenceDevice:
    """This machine as the reference device `device` of a server."""

    server: Server
    device: str
    token: str
    home: Home
    console: Console
    pause: Callable[[float], None]
    backend: str | None = None
    # Leases whose results were reported but could not be deleted here.
    reported: set[str] = field(default_factory=set)

    def serve_next(self) -> bool:
        """Report a stored result, or measure an evaluation; False where there is neither."""
        kept = self.home.read(RESULTS).get(self._key)
        if kept is not None and kept["lease"] not in self.reported:
            self.console.say(f"{kept['lease']}: its result is still to be sent")
            self._report(kept["lease"], kept["result"])
            return True
        worker = platform.node()
        answer = self._retry(lambda: self.server.lease(self.token, self.device, worker))
        if answer is None:
            return False
        try:
            lease = read_lease(answer)
        except NotFrontrunnerError as error:
            # A client of another version may read it: this one retries with growing pauses.
            self.return_lease(str(answer.get("id")), str(error))
            self.console.say(f"{error}; again in {LONGEST_PAUSE_SECONDS:.0f} s")
            self.pause(LONGEST_PAUSE_SECONDS)
            return True
        if (measured := self.measure(lease)) is not None:
            result = msgspec.to_builtins(measured)
            self._store(lease.id, result)
            self._report(lease.id, result)
        return True

    def heartbeat(self, lease: Lease) -> bool:
        """Renew `lease`; False if it is gone."""
        try:
            self.server.heartbeat(self.token, lease.id)
        except ProblemError as problem:
            return problem.status != GONE
        except (UnreachableError, NotFrontrunnerError):
            pass  # the measurement goes on: the server may be back before the lease expires
        return True

    def measure(self, lease: Lease) -> Result | None:
        """The outcome of `lease`; None if the lease has ended or was returned."""

        def heartbeat() -> bool:
            return self.heartbeat(lease)

        # The configuration is sent, too: after a restore the server may use this id for another evaluation.
        result = partial(Result, software=f"{APP} {__version__}", configuration=lease.configuration)
        try:
            requirements.require(lease.application)
            if self.backend not in (None, lease.backend):
                raise CannotMeasureError(
                    f"--backend {self.backend}: the server has {self.device} measure over {lease.backend}"
                )
            packs = [
                sequences.find_complete(leased, self.home) or self._download(leased, lease, heartbeat)
                for leased in lease.sequences
            ]
            with self.home.only_one("measurement") as alone:
                if not alone:  # another client began meanwhile
                    self.return_lease(lease.id)
                    return None
                backends = selection.backends_for(lease.application, lease.backend)
                chosen = selection.choose(lease.opencl_device, backends)
                self.console.say(f"{lease.id}: measuring over {len(packs)} sequences on {chosen.label}")
                measured = isolated.measure(
                    lease.application,
                    lease.configuration,
                    packs,
                    device=chosen.label,
                    backend=chosen.backend,
                    frames=lease.frames,
                    perturbation=lease.perturbation or None,
                    stop_above=lease.stop_above,
                    stop_after=lease.stop_after,
                    learned_on=lease.learned_on,
                    decoded=self.home.decoded,
                    heartbeat=heartbeat,
                    heartbeat_seconds=lease.heartbeat_seconds,
                    timeout=lease.timeout_seconds,
                )
        except MeasurementError as error:
            self.console.say(f"{lease.id}: failed: {error}")
            return result("failed", error=one_line(str(error)))
        except LeaseLostError:
            self.console.say(f"{lease.id}: the lease is gone, the measurement was ended")
            return None
        except CannotMeasureHereError as error:
            self.return_lease(lease.id, str(error))
            raise CannotMeasureError(str(error)) from error
        except ClientError as error:
            self.return_lease(lease.id, str(error))
            raise
        except KeyboardInterrupt:
            self.return_lease(lease.id)
            raise
        self.console.say(f"{lease.id}: {_summary(lease, measured)}")
        return result(
            "done",
            objectives=measured.objectives,
            parts=list(map(Part.of, measured.parts)),
            **as_measured(measured),
        )

    def _download(self, leased: Sequence, lease: Lease, heartbeat: Callable[[], bool]) -> Path:
        """A sequence of `lease`, retried while the server is away. Raises LeaseLostError."""
        held = time.monotonic()

        def hold(done: int = 0, total: int = 0) -> None:
            nonlocal held
            if total:
                self.console.bar(leased.name, done // 1000, total // 1000, " kB")
            if time.monotonic() - held >= lease.heartbeat_seconds:
                held = time.monotonic()
                if not heartbeat():
                    raise LeaseLostError

        def fetch() -> Path:
            hold()
            return sequences.fetch(self.server, leased, self.home, progress=hold, pause=self.pause)

        path: Path = self._retry(fetch)
        return path

    def _report(self, lease: str, result: Mapping[str, Any]) -> None:
        """Report a result to the server, and delete the stored copy."""
        try:
            self._retry(lambda: self.server.finish(self.token, lease, result))
        except ProblemError as problem:
            self.console.say(f"{lease}: the result was not taken: {problem}")
        except KeyboardInterrupt:
            self.console.say(f"{lease}: its result is stored here and sent by the next `evaluate`")
            raise
        self.reported.add(lease)
        try:
            with self.home.only_one("results", wait=True):
                results = self.home.read(RESULTS)
                if results.get(self._key, {}).get("lease") == lease:
                    del results[self._key]
                    self.home.write(RESULTS, results)
        except HomeError as error:  # another process will report it again, without effect
            self.console.say(str(error))

    def _store(self, lease: str, result: Mapping[str, Any]) -> None:
        kept = {"lease": lease, "result": result}
        try:
            with interrupts.ignored(), self.home.only_one("results", wait=True):
                self.home.write(RESULTS, {**self.home.read(RESULTS), self._key: kept})
        except HomeError as error:  # it can still be sent by this process
            self.console.say(str(error))

    @property
    def _key(self) -> str:
        return f"{self.server.url} {self.device}"

    def return_lease(self, lease: str, reason: str = "") -> None:
        """Let another machine measure the evaluation; `reason`: why this one cannot."""
        try:
            result = msgspec.to_builtins(Result("returned", error=one_line(reason)))
            self.server.finish(self.token, lease, result)
        except ClientError as error:
            self.console.say(f"{lease} could not be returned; its lease will expire: {error}")
        else:
            self.console.say(f"{lease} is returned")

    def _retry(self, ask: Callable[[], Any]) -> Any:
        """The answer of `ask`, retried with growing pauses while the server is unavailable."""
        seconds = FIRST_PAUSE_SECONDS
        while True:
            try:
                return ask()
            except ProblemError as problem:
                if problem.status in (401, 403):
                    raise UsageError(str(problem)) from problem
                if not problem.temporary and problem.status != 409:
                    raise
                wait, reason = problem.retry_after or seconds, str(problem)
            except (UnreachableError, NotFrontrunnerError) as error:
                wait, reason = seconds, str(error)
            self.console.say(f"{reason}; again in {wait:.0f} s")
            self.pause(wait)
            seconds = min(2 * seconds, LONGEST_PAUSE_SECONDS)


def _summary(lease: Lease, measured: Measurement) -> str:
    """The measurement in one line, for people."""
    values, run, wanted = measured.objectives, len(measured.parts), len(lease.sequences)
    stopped = [part["stopped_at"] for part in measured.parts if part["stopped_at"] is not None]
    over = "" if wanted == 1 else f" over {run} of {wanted} sequences"
    least = "at least " if run < wanted or stopped else ""
    early = f", stopped after {stopped[-1]} frames" if stopped else ""
    return f"{1e3 * values['runtime']:.2f} ms a frame, {least}{1e2 * values['ate_max']:.2f} cm{over}{early}"
