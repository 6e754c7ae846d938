"""`run`: from the server's manifest to a measured, kept and sent session, and what it showed."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from client_kit import consent, delivery, device, enrolment, manifest, measurement, sensors, sequences
from client_kit.console import Console
from client_kit.errors import CannotMeasureError, UsageError
from client_kit.home import Home
from client_kit.manifest import Manifest
from client_kit.measurement import Session
from client_kit.server import Server, ServerError
from client_kit.spool import ACCEPTED, DUPLICATE, Item, Spool
from slam.datasets import open_sequence
from slam.opencl import NoDeviceError, choose_device

SUMMARY_PATIENCE_SECONDS = 15.0
SUMMARY_PAUSE_SECONDS = 0.5


@dataclass(frozen=True)
class Wishes:
    """What the participant asked for on the command line."""

    server: str
    yes: bool = False
    sessions: int = 1
    configurations: tuple[str, ...] = ()
    device: str | None = None
    ignore_battery: bool = False


def run(
    wishes: Wishes,
    home: Home,
    console: Console,
    *,
    pause: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
) -> None:
    """Measure `wishes.sessions` sessions and send them; what cannot be sent now stays in the spool.

    Raises ClientError, with the exit code of its kind, when nothing can be measured.
    """
    server = Server(wishes.server)
    spool = Spool(home.spool)
    console.lines(delivery.deliver(spool, home).lines())

    asked, fresh = manifest.fetch(server, home)
    if not fresh:
        console.say(f"{server.url} does not answer: measuring what it asked for at the last visit.")
    asked.require_this_version()
    asked.require_accepting()
    plan = asked.plan(wishes.configurations)
    chosen, identity = _device(wishes.device, root)
    _consent(wishes, home, console, server, asked, identity)
    _battery(wishes, root)
    sequence = open_sequence(_sequence(server, asked, home, console, fresh))

    console.say(f"Device: {identity['opencl_device']} ({identity['opencl_platform']})")
    console.say(f"Order: {', '.join(plan)}, {asked.protocol.frames} frames each")
    for number in range(wishes.sessions):
        if number:
            pause(asked.protocol.rest_seconds)
            _battery(wishes, root)
        with home.only_one("measurement") as alone:
            if not alone:
                raise CannotMeasureError("another client measures on this device: wait until it is done")
            session = measurement.measure(
                sequence,
                asked,
                plan,
                device=chosen,
                on_run=lambda run: console.say(_run_line(run, asked)),
                on_frame=console.bar,
                rest=pause,
                root=root,
            )
        item = spool.put(server.url, measurement.payload(session, asked, identity))
        delivered = delivery.deliver(spool, home)
        console.lines(_figures(session, asked))
        console.lines(delivered.lines())
        settled = spool.item(item.id)
        if settled.state in (ACCEPTED, DUPLICATE):
            _tell_page(server, home, settled, asked, console, pause)
        if delivered.outdated is not None:
            raise delivered.outdated
        if all(run.status == "failed" for run in session.runs):
            raise CannotMeasureError(f"no configuration runs here: {session.runs[0].failure}")


def _device(text: str | None, root: Path) -> tuple[str, dict[str, str | None]]:
    """The label that picks the OpenCL device to use, and what this machine says of itself."""
    try:
        chosen = choose_device(text)
    except NoDeviceError as error:
        raise CannotMeasureError(str(error)) from error
    except ImportError as error:
        raise CannotMeasureError(f"pyopencl cannot be used here ({error}): pip install pyopencl") from error
    return chosen.label, device.identify(root, opencl=device.opencl_identity(chosen.handle))


def _consent(
    wishes: Wishes,
    home: Home,
    console: Console,
    server: Server,
    asked: Manifest,
    identity: dict[str, str | None],
) -> None:
    version = asked.consent_version
    if consent.given(home, server.url, version):
        return
    size = sum(chunk.bytes for chunk in asked.chunks)
    console.say(consent.text(server.url, version, size, _sample_payload(asked, identity)))
    if not wishes.yes:
        if not sys.stdin.isatty():
            raise UsageError("nobody is here to agree: read the text above, then add --yes")
        if not console.ask("Do you agree?"):
            raise CannotMeasureError("nothing was measured or sent: you did not agree")
    consent.remember(home, server.url, version)


def _sample_payload(asked: Manifest, identity: dict[str, str | None]) -> dict[str, Any]:
    """What would be sent of this device, with a run of two frames for brevity."""
    example = measurement.Run(
        "a random number", "default", 0, 0, "ok", None, (31250, 30718), {"tracking": (9120, 8980)},
        (True, True), 0.012, 0.008, 0.009, "digest of the computed trajectory",
    )  # fmt: skip
    sample: sensors.Sample = {"t": 0.0, "temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": 80.0}
    session = Session("a random number", "2026-01-01T12:00:00Z", "opencl", (example,), (sample,))
    return measurement.payload(session, asked, identity)


def _battery(wishes: Wishes, root: Path) -> None:
    charge = sensors.battery(root)
    if charge is not None and charge.low and not wishes.ignore_battery:
        raise CannotMeasureError(
            f"the battery is at {charge.percent:.0f} %: plug the device in, or add --ignore-battery"
        )


def _sequence(server: Server, asked: Manifest, home: Home, console: Console, fresh: bool) -> Path:
    present = sequences.at_hand(asked, home)
    if present is not None:
        return present
    if not fresh:
        raise CannotMeasureError(f"{server.url} does not answer and its sequence is not here yet: try later")
    name, size = asked.sequence["name"], sum(chunk.bytes for chunk in asked.chunks)
    console.say(f"Downloading the sequence {name}, {size / 1e6:.1f} MB")
    return sequences.fetch(
        server,
        asked,
        home,
        progress=lambda done, total: console.bar(str(name), done // 1000, total // 1000, " kB"),
    )


def _run_line(run: measurement.Run, asked: Manifest) -> str:
    if run.status == "failed":
        return f"  {run.order + 1}. {run.configuration}: failed, {run.failure}"
    line = f"  {run.order + 1}. {run.configuration}: {1000 * run.mean_seconds(asked.protocol):.2f} ms a frame"
    return line if run.ate_max is None else f"{line}, largest error {100 * run.ate_max:.2f} cm"


def _figures(session: Session, asked: Manifest) -> Sequence[str]:
    """The session's outcome in plain words, one line for each configuration against the default."""
    protocol = asked.protocol
    counted = protocol.frames - protocol.first_counted_frame
    lines = [""]
    for name in dict.fromkeys(run.configuration for run in session.runs):
        errors = [run.ate_max for run in session.of(name) if run.ate_max is not None]
        if errors:
            limit = f"{100 * protocol.max_ate:.0f} cm allowed"
            lines.append(f"{name}: largest trajectory error {100 * max(errors):.2f} cm ({limit})")
    for name in dict.fromkeys(run.configuration for run in session.runs):
        if name == "default":
            continue
        speedup = session.speedup(name, protocol)
        if speedup is None:
            lines.append(f"No speedup for {name}: no pair of runs ran through and stayed within the limit.")
        else:
            slower = "" if speedup >= 1 else " (slower)"
            lines.append(
                f"Speedup of {name} over default: {speedup:.2f}{slower}, mean over {counted} frames a run."
            )
            lines.append(
                f"On this device {name} computes a frame in {100 / speedup:.0f} % of the default's time."
            )
    return lines


def _tell_page(
    server: Server,
    home: Home,
    item: Item,
    asked: Manifest,
    console: Console,
    pause: Callable[[float], None],
) -> None:
    """Point to the device's page, and say what of the session counts there, once the server knows."""
    token = enrolment.token(home, server, asked.consent_version)
    waited = 0.0
    while True:
        try:
            state = server.submission(token, str(item.submission_id))
        except ServerError as error:
            console.say(f"The session is accepted; its page could not be asked for: {error}")
            return
        if state.get("summarised") or waited >= SUMMARY_PATIENCE_SECONDS:
            break
        pause(SUMMARY_PAUSE_SECONDS)
        waited += SUMMARY_PAUSE_SECONDS
    for session in state.get("sessions") or ():
        for told in session.get("speedups") or ():
            if told.get("state") != "valid":
                name, reason = told.get("configuration"), told.get("reason")
                console.say(f"The server sets {name} aside: {told.get('state')}, {reason}")
    if state.get("device"):
        page = server.page(f"devices/{state['device']}/")
        console.say(f"See this device among the others: {page}")
    else:
        console.say(f"The server has not worked through this session yet: {server.page('devices/')}")
