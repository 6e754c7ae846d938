"""Serving as a reference device: take an evaluation, measure it in a process of its own, tell the result.

The server's word is the truth. While it cannot be reached a measurement goes on and its result is kept until
the server takes it or says that nobody waits for it any more.
"""

import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from client_kit import APP, __version__, sequences
from client_kit.console import Console
from client_kit.errors import CannotMeasureError, ClientError, UsageError
from client_kit.home import Home
from client_kit.manifest import DIGEST, Chunk, read_chunk
from client_kit.server import NotFrontrunnerError, ProblemError, Server, UnreachableError
from slam import isolated
from slam.isolated import CannotMeasureHereError, LeaseLostError, MeasurementError, one_line

IDLE_SECONDS = 5.0
FIRST_PAUSE_SECONDS = 1.0
LONGEST_PAUSE_SECONDS = 60.0
GONE = 410


@dataclass(frozen=True)
class Lease:
    """One evaluation to be measured; `frames` None is the whole sequence. Times in seconds."""

    id: str
    application: str
    configuration: Mapping[str, Any]
    frames: int | None
    opencl_device: str
    sequence: Mapping[str, Any]
    chunks: tuple[Chunk, ...]
    heartbeat_seconds: float
    timeout_seconds: float

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "Lease":
        """DOCUMENT, an answer of POST /leases, checked. Raises NotFrontrunnerError."""
        try:
            sequence = document["sequence"]
            if not DIGEST.fullmatch(sequence["sha256"]):
                raise ValueError(f"sequence.sha256 is {sequence['sha256']!r}")
            return cls(
                id=str(document["id"]),
                application=str(document["application"]),
                configuration=dict(document["configuration"]),
                frames=None if document["frames"] is None else int(document["frames"]),
                opencl_device=str(document["opencl_device"]),
                sequence=sequence,
                chunks=tuple(read_chunk(chunk) for chunk in sequence["chunks"]),
                heartbeat_seconds=float(document["heartbeat_seconds"]),
                timeout_seconds=float(document["timeout_seconds"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise NotFrontrunnerError(f"the lease cannot be read: {error!r}") from error


def serve(
    server: Server,
    device: str,
    token: str,
    home: Home,
    console: Console,
    until_idle: bool = False,
    pause: Callable[[float], None] = time.sleep,
) -> None:
    """Measure what waits for DEVICE, one evaluation after another, until Ctrl-C or, if wanted, until idle.

    Raises UsageError for a token that is not this device's, and, after giving the present evaluation back,
    KeyboardInterrupt, CannotMeasureError where nothing can be measured here, and OutdatedError.
    """
    worker = platform.node()
    console.say(f"Serving {server.url} as {device}. Ctrl-C ends it and gives the present evaluation back.")
    while True:
        answer = _insist(lambda: server.lease(token, device, worker), console, pause)
        if answer is None:
            if until_idle:
                console.say("Nothing waits.")
                return
            pause(IDLE_SECONDS)
            continue
        try:
            lease = Lease.parse(answer)
        except NotFrontrunnerError as error:
            # Another client, of another version, may read it: this one asks less and less often.
            _give_back(server, token, str(answer.get("id")), console, str(error))
            console.say(f"{error}; again in {LONGEST_PAUSE_SECONDS:.0f} s")
            pause(LONGEST_PAUSE_SECONDS)
            continue
        result = _measure(server, token, lease, home, console, pause)
        if result is not None:
            _tell(server, token, lease, result, console, pause)


def _measure(
    server: Server,
    token: str,
    lease: Lease,
    home: Home,
    console: Console,
    pause: Callable[[float], None],
) -> dict[str, Any] | None:
    """What became of LEASE; None where nobody waits for it any more."""

    def heartbeat() -> bool:
        try:
            server.heartbeat(token, lease.id)
        except ProblemError as problem:
            return problem.status != GONE
        except (UnreachableError, NotFrontrunnerError):
            pass  # the measurement goes on: the server may be back before the lease runs out
        return True

    software = f"{APP} {__version__}"
    try:
        pack = sequences.at_hand(lease, home) or _download(server, lease, home, heartbeat, console, pause)
        measured = isolated.measure(
            lease.application,
            lease.configuration,
            pack,
            device=lease.opencl_device,
            frames=lease.frames,
            heartbeat=heartbeat,
            heartbeat_seconds=lease.heartbeat_seconds,
            timeout=lease.timeout_seconds,
        )
    except MeasurementError as error:
        console.say(f"{lease.id}: failed: {error}")
        return {"status": "failed", "error": one_line(str(error)), "software": software}
    except LeaseLostError:
        console.say(f"{lease.id}: the lease is gone, the measurement was ended")
        return None
    except CannotMeasureHereError as error:
        _give_back(server, token, lease.id, console, str(error))
        raise CannotMeasureError(str(error)) from error
    except ClientError as error:
        _give_back(server, token, lease.id, console, str(error))
        raise
    except KeyboardInterrupt:
        _give_back(server, token, lease.id, console)
        raise
    runtime = measured.objectives["runtime"]
    console.say(f"{lease.id}: {1e3 * runtime:.2f} ms a frame, {1e3 * measured.objectives['ate_max']:.1f} mm")
    return {
        "status": "done",
        "objectives": measured.objectives,
        "stages": measured.stages,
        "device": measured.device,
        "software": software,
    }


def _download(
    server: Server,
    lease: Lease,
    home: Home,
    heartbeat: Callable[[], bool],
    console: Console,
    pause: Callable[[float], None],
) -> Path:
    """The sequence, however often the server goes away meanwhile. Raises LeaseLostError."""
    held = time.monotonic()

    def hold(*_: int) -> None:
        nonlocal held
        if time.monotonic() - held >= lease.heartbeat_seconds:
            held = time.monotonic()
            if not heartbeat():
                raise LeaseLostError

    def fetch() -> Path:
        hold()
        return sequences.fetch(server, lease, home, progress=hold, pause=pause)

    found: Path = _insist(fetch, console, pause)
    return found


def _tell(
    server: Server,
    token: str,
    lease: Lease,
    result: Mapping[str, Any],
    console: Console,
    pause: Callable[[float], None],
) -> None:
    try:
        _insist(lambda: server.finish(token, lease.id, result), console, pause)
    except ProblemError as problem:
        console.say(f"{lease.id}: the result was not taken: {problem}")


def _give_back(server: Server, token: str, lease: str, console: Console, reason: str = "") -> None:
    result = {"status": "returned"} | ({"error": one_line(reason)} if reason else {})
    try:
        server.finish(token, lease, result)
    except ClientError as error:
        console.say(f"{lease} could not be given back, its lease will run out: {error}")
    else:
        console.say(f"{lease} is given back")


def _insist(ask: Callable[[], Any], console: Console, pause: Callable[[float], None]) -> Any:
    """What ASK answers, asked again with longer and longer pauses while the server cannot."""
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
        console.say(f"{reason}; again in {wait:.0f} s")
        pause(wait)
        seconds = min(2 * seconds, LONGEST_PAUSE_SECONDS)
