"""`run`: from the server's manifest to a measured, kept and sent session, and what it showed."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from client_kit import (
    consent,
    delivery,
    device,
    drivers,
    enrolment,
    interrupts,
    manifest,
    measurement,
    preflight,
    requirements,
    sensors,
    sequences,
    session,
    summary,
)
from client_kit.console import Console
from client_kit.errors import CannotMeasureError, UsageError
from client_kit.home import Home
from client_kit.manifest import Manifest
from client_kit.server import Server, ServerError
from client_kit.session import Session
from client_kit.spool import ACCEPTED, DUPLICATE, Item, Spool
from slam.devices.choice import choose_device
from slam.devices.device import Device, NoDeviceError

SUMMARY_PATIENCE_SECONDS = 15.0
SUMMARY_PAUSE_SECONDS = 0.5
# A device that has just measured is hot: so often, and for so long, it may cool before the next session.
COOLING_PAUSES, COOLING_SECONDS = 5, 60.0
WITHDRAWN = "your agreement was withdrawn meanwhile: what was measured is not kept"


@dataclass(frozen=True)
class Wishes:
    """What the participant asked for. `ignored` names concerns of `preflight` to measure in spite of;
    `minutes` is how long a session may repeat its runs, as the server asks where it is None;
    `show_model` whether a rare device's model may be shown in public, None to leave that as it is;
    `application` what to measure, None for what the server has clients measure."""

    server: str
    yes: bool = False
    sessions: int = 1
    configurations: tuple[str, ...] = ()
    device: str | None = None
    ignored: tuple[str, ...] = ()
    minutes: float | None = None
    show_model: bool | None = None
    application: str | None = None


@dataclass(frozen=True)
class Measured:
    """A session that was measured, and what the spool knows of it."""

    session: Session
    item: Item


def run(
    wishes: Wishes,
    home: Home,
    console: Console,
    *,
    pause: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
) -> list[Measured]:
    """Measure `wishes.sessions` sessions and send them; what cannot be sent now stays in the spool.

    More configurations than one session holds make several; a device that does not cool between them ends
    with those that are done. Raises ClientError, with the exit code of its kind, when nothing can be
    measured, and KeyboardInterrupt after what was finished is kept.
    """
    server, spool = Server(wishes.server), Spool(home.spool)
    console.lines(delivery.deliver(spool, home).lines())
    asked, fresh = manifest.fetch(server, home, wishes.application)
    if not fresh:
        console.say(f"{server.url} does not answer: measuring what it asked for at the last visit.")
    asked.require_this_version()
    asked.require_accepting()
    requirements.require(asked.application, root)
    if wishes.minutes is not None:
        asked = replace(asked, protocol=replace(asked.protocol, max_seconds=60 * wishes.minutes))
    plans = asked.plans(wishes.configurations)
    chosen, identity = _device(wishes.device, root)
    _consent(wishes, home, console, server, asked, identity)
    delivery.renew(spool, home, server.url, asked.consent_version)
    present = sequences.at_hand(asked, home)
    _ready(wishes, home, console, root, download=0 if present else sequences.size(asked))
    path = present or _download(server, asked, home, console, fresh)

    console.say(f"Application: {asked.application}, front {asked.front_version}")
    console.say(f"Device: {identity['opencl_device']} ({identity['opencl_platform']})")

    def agreed() -> None:
        if not consent.given(home, server.url, asked.consent_version):
            raise CannotMeasureError(WITHDRAWN)

    measured: list[Measured] = []
    planned = plans * wishes.sessions
    for number, plan in enumerate(planned):
        if number:
            pause(asked.protocol.rest_seconds)
            if not _ready_again(wishes, home, console, pause, root):
                console.say(f"{number} of {len(planned)} sessions are done.")
                break
        console.say(f"Order: {', '.join(plan)}, {asked.protocol.frames} frames each")
        done = _measure(path, asked, plan, chosen, home, console, pause, root)
        payload = session.payload(done, asked, identity, wishes.show_model)
        with interrupts.ignored():
            item = spool.put(server.url, payload, agreed)
        if done.interrupted:
            console.say(f"Stopped: the {len(done.runs)} finished runs are kept.")
            raise KeyboardInterrupt
        delivered = delivery.deliver(spool, home)
        console.lines(summary.stages(done, asked.protocol))
        console.lines(summary.figures(done, asked.protocol))
        console.lines(delivered.lines())
        kept = spool.find(item.id)
        if kept is None:
            raise CannotMeasureError(WITHDRAWN)
        measured.append(Measured(done, kept))
        if measured[-1].item.state in (ACCEPTED, DUPLICATE):
            _tell_page(server, home, measured[-1], asked, console, pause)
        if delivered.outdated is not None:
            raise delivered.outdated
        if all(one.status == "failed" for one in done.runs):
            raise CannotMeasureError(f"no configuration runs here: {done.runs[0].failure}")
    return measured


def consent_text(
    server: str,
    home: Home,
    device: str | None = None,
    application: str | None = None,
    root: Path = Path("/"),
) -> str | None:
    """What a participant has to agree to before `run`; None where this was agreed to before."""
    connection = Server(server)
    asked, _ = manifest.fetch(connection, home, application)
    if consent.given(home, connection.url, asked.consent_version):
        return None
    return _consent_text(connection, asked, _device(device, root)[1])


def _measure(
    path: Path,
    asked: Manifest,
    plan: tuple[str, ...],
    chosen: Device,
    home: Home,
    console: Console,
    pause: Callable[[float], None],
    root: Path,
) -> Session:
    parameters = {name: asked.configurations[name].parameters for name in plan}
    with home.only_one("measurement") as alone:
        if not alone:
            raise CannotMeasureError("another client measures on this device: wait until it is done")
        return measurement.measure(
            path,
            asked,
            plan,
            device=chosen.label,
            impossible=preflight.too_large(parameters, chosen, root),
            on_run=lambda run: console.say(summary.run_line(run, asked.protocol)),
            on_frame=lambda label, done, total, left: console.bar(label, done, total, left=left),
            rest=pause,
            root=root,
        )


def _device(text: str | None, root: Path) -> tuple[Device, dict[str, str | None]]:
    """The OpenCL device to use, and what this machine says of itself."""
    try:
        chosen = choose_device(text)
    except (NoDeviceError, ImportError) as error:
        raise CannotMeasureError(drivers.remedy(error, root)) from error
    return chosen, device.identify(root, opencl=device.opencl_identity(chosen.handle))


def _ready(wishes: Wishes, home: Home, console: Console, root: Path, download: int) -> None:
    found = preflight.concerns(home, root, download=download)
    for concern in preflight.require_fit(found, wishes.ignored):
        console.say(f"Note: {concern.text}")


def _ready_again(
    wishes: Wishes, home: Home, console: Console, pause: Callable[[float], None], root: Path
) -> bool:
    """Whether another session can be measured after one, once the device has cooled; the load that the one
    before has left says nothing."""
    for pauses in range(COOLING_PAUSES + 1):
        found = [concern for concern in preflight.concerns(home, root) if concern.name != preflight.LOAD]
        stopping = [concern for concern in found if concern.stops and concern.name not in wishes.ignored]
        if not stopping:
            return True
        if pauses == COOLING_PAUSES or stopping[0].name != preflight.THROTTLING:
            break
        console.say(f"{stopping[0].text}; again in {COOLING_SECONDS:.0f} s")
        pause(COOLING_SECONDS)
    console.say(f"No further session: {stopping[0].text}")
    return False


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
    console.say(_consent_text(server, asked, identity, wishes.show_model))
    if not wishes.yes:
        if console.silent or not sys.stdin.isatty():
            raise UsageError("nobody is here to agree: read the text above, then add --yes")
        if not console.ask("Do you agree?"):
            raise CannotMeasureError("nothing was measured or sent: you did not agree")
    consent.remember(home, server.url, version)


def _consent_text(
    server: Server, asked: Manifest, identity: dict[str, str | None], show_model: bool | None = None
) -> str:
    sample = _sample_payload(asked, identity, show_model)
    return consent.text(server.url, asked.consent_version, sequences.size(asked), sample)


def _sample_payload(
    asked: Manifest, identity: dict[str, str | None], show_model: bool | None
) -> dict[str, Any]:
    """What would be sent of this device, with a run of two frames for brevity."""
    example = session.Run(
        "a random number", "default", 0, 0, "ok", None, (31250, 30718), {"tracking": (9120, 8980)},
        (True, True), 0.012, 0.008, 0.009, "digest of the computed trajectory",
    )  # fmt: skip
    sample: sensors.Sample = {"t": 0.0, "temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": 80.0}
    told = Session("a random number", "2026-01-01T12:00:00Z", "opencl", (example,), (sample,))
    return session.payload(told, asked, identity, show_model)


def _download(server: Server, asked: Manifest, home: Home, console: Console, fresh: bool) -> Path:
    if not fresh:
        raise CannotMeasureError(f"{server.url} does not answer and its sequence is not here yet: try later")
    name = asked.sequence["name"]
    console.say(f"Downloading the sequence {name}, {sequences.size(asked) / 1e6:.1f} MB")
    return sequences.fetch(
        server,
        asked,
        home,
        progress=lambda done, total: console.bar(str(name), done // 1000, total // 1000, " kB"),
    )


def _tell_page(
    server: Server,
    home: Home,
    measured: Measured,
    asked: Manifest,
    console: Console,
    pause: Callable[[float], None],
) -> None:
    """Point to the pages that show it, and say what of the session counts there, once the server knows."""
    try:
        state = _summarised(server, home, measured.item, pause)
    except ServerError as error:
        console.say(f"The session is accepted; its page could not be asked for: {error}")
        return
    aside = set()
    for told_session in state.get("sessions") or ():
        for told in told_session.get("speedups") or ():
            if told.get("state") != "valid":
                name, reason = told.get("configuration"), told.get("reason")
                aside.add(name)
                console.say(f"The server sets {name} aside: {told.get('state')}, {reason}")
    own_speedup = summary.best_speedup(measured.session, asked.protocol)
    # Neither a speedup that does not count nor a device that the server does not tell yet has a place.
    if own_speedup is not None and own_speedup[0] not in aside and state.get("device"):
        _tell_place(server, own_speedup, measured.session.backend, asked, str(state["device"]), console)
    if state.get("page"):
        own = server.page(str(state["page"]))
        console.say(f"Your own page, which names this device (whoever has the link may read it): {own}")
    if state.get("device"):
        console.say(f"Among the others: {server.page('devices/' + str(state['device']) + '/')}")
    else:
        console.say(f"The server has not worked through this session yet: {server.page('devices/')}")


def _summarised(server: Server, home: Home, item: Item, pause: Callable[[float], None]) -> dict[str, Any]:
    token = enrolment.present(home, server)
    if token is None:  # erased meanwhile, and nobody is to be enrolled anew for a look
        return {}
    waited = 0.0
    while True:
        state = server.submission(token, str(item.submission_id))
        if state.get("summarised") or waited >= SUMMARY_PATIENCE_SECONDS:
            return state
        pause(SUMMARY_PAUSE_SECONDS)
        waited += SUMMARY_PAUSE_SECONDS


def _tell_place(
    server: Server, own: tuple[str, float], backend: str, asked: Manifest, device: str, console: Console
) -> None:
    name, speedup = own
    try:
        crowd = server.speedups(str(asked.front_version), name)
        console.say(summary.place(crowd, speedup, device, backend))
    except (ServerError, KeyError, TypeError, ValueError) as error:
        console.say(f"The place in the crowd could not be asked for: {error}")
