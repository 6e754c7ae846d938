"""`run`: from the server's manifest to a measured, stored and sent session, and its result."""

import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from client_kit.console import Console
from client_kit.delivery import consent, enrolment, manifest, reference_trajectories, sending, sequences
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import Server
from client_kit.delivery.spool import Spool
from client_kit.device import description, preflight, requirements, selection
from client_kit.device.sources import line
from client_kit.errors import CannotMeasureError, ClientError, UsageError
from client_kit.home import Home
from client_kit.measuring import probes
from client_kit.measuring.session import Run, Session, begin, payload
from client_kit.measuring.worker_client import COMPILING_MINUTES
from client_kit.participating.session_recorder import Measured, SessionRecorder
from slam.devices.choice import NAMES
from slam.devices.device import Device
from wire.session import Sample

# A device that has just measured is hot: the number and length of pauses to cool before the next session.
COOLING_PAUSES, COOLING_SECONDS = 5, 60.0


@dataclass(frozen=True)
class RunOptions:
    """The options of `run`.

    `ignored` names concerns of `preflight` to ignore. `show_model`: whether a rare device's model may be
    shown in public, None to leave that unchanged. `application` is what to measure, None for the server's
    choice. `backend` drives the device, None for the fastest. `probes`: whether to measure the server's
    probes afterwards, None to ask. `compiling_minutes`: how long a driver may compile without an answer.
    """

    server: str
    yes: bool = False
    sessions: int = 1
    configurations: tuple[str, ...] = ()
    device: str | None = None
    ignored: tuple[str, ...] = ()
    show_model: bool | None = None
    application: str | None = None
    backend: str | None = None
    probes: bool | None = None
    compiling_minutes: int = COMPILING_MINUTES


def run(
    options: RunOptions,
    home: Home,
    console: Console,
    *,
    pause: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
) -> list[Measured]:
    """Measure `options.sessions` sessions and send them; unsent ones stay in the spool.

    More configurations than one session holds are split into several; if a device does not cool between them,
    the rest is skipped. A session of probes may follow, if the participant agrees. Raises ClientError when
    nothing can be measured, and KeyboardInterrupt after finished runs are stored.
    """
    server, spool = Server(options.server), Spool(home.spool)
    console.lines(sending.deliver(spool, home).lines())
    asked, fresh = manifest.fetch(server, home, options.application)
    if not fresh:
        console.say(f"{server.url} does not answer: using its manifest from the last visit.")
    asked.require_this_version()
    asked.require_accepting()
    requirements.require(asked.application, root)
    names = asked.names(options.configurations)
    chosen, identity = _device(options.device, options.backend, asked.application, root)
    plans = asked.plans(_select_runnable(names, asked, chosen.backend, console))
    _consent(options, home, console, server, asked, chosen, identity)
    sending.renew(spool, home, server.url, asked.consent_version)
    present = sequences.find_complete(asked.sequence, home)
    _ready(options, home, console, root, download=0 if present else sequences.size(asked.sequence))
    path = present or _download(server, asked, home, console, fresh)
    if not reference_trajectories.all_present(asked, home):
        _require_fresh(fresh, server, "reference trajectories are")
        reference_trajectories.fetch(server, asked, home)

    console.say(f"Application: {asked.application}, front {asked.front_version}")
    console.say(f"Device: {chosen.name} ({chosen.platform}) over {NAMES[chosen.backend]}")

    recorder = SessionRecorder(
        server,
        home,
        spool,
        console,
        chosen,
        identity,
        options.show_model,
        pause,
        root,
        options.compiling_minutes,
    )
    measured: list[Measured] = []
    planned = plans * options.sessions
    for number, plan in enumerate(planned):
        if number:
            pause(asked.protocol.rest_seconds)
            if not _ready_again(options, home, console, pause, root):
                console.say(f"{number} of {len(planned)} sessions are done.")
                return measured
        measured.append(recorder.record(path, asked, plan))
    if _may_probe(options, console, measured[-1]):
        measured += _probes(options, recorder, asked, measured[-1].session)
    return measured


def consent_text(
    server: str,
    home: Home,
    device: str | None = None,
    application: str | None = None,
    backend: str | None = None,
    root: Path = Path("/"),
) -> str | None:
    """The consent text to agree to before `run`; None if already agreed."""
    connection = Server(server)
    asked, _ = manifest.fetch(connection, home, application)
    if consent.is_agreed(home, connection.url, asked.consent_version):
        return None
    requirements.require(asked.application, root)
    chosen, identity = _device(device, backend, asked.application, root)
    return _consent_text(connection, asked, chosen, identity)


def _may_probe(options: RunOptions, console: Console, last: Measured) -> bool:
    """Whether probes may follow the session `last`: the participant wants them, or can be asked."""
    ordinary = not options.configurations and last.accepted
    if options.probes is None:
        return ordinary and console.can_ask
    return ordinary and options.probes


def _probes(
    options: RunOptions, recorder: SessionRecorder, asked: Manifest, ordinary: Session
) -> list[Measured]:
    """Measure the probes that the server assigns after the session `ordinary`, if the participant agrees.

    Any obstacle is reported in a line: the ordinary session is complete without probes.
    """
    console = recorder.console
    default = probes.default_seconds(ordinary, asked.protocol)
    # A participant is asked at once, before the device has cooled.
    pauses = COOLING_PAUSES if options.probes else 0
    if default is None or not _ready_again(
        options, recorder.home, console, recorder.pause, recorder.root, pauses
    ):
        return []
    try:
        prepared = _prepared_probes(options, recorder, asked.application, default)
    except ClientError as error:
        console.say(f"No further configurations are measured: {error}")
        return []
    if prepared is None:
        return []
    path, assigned, names = prepared
    measured = recorder.record(path, assigned, assigned.plan(names), with_pages=False)
    console.say(probes.thanks(measured.session))
    return [measured]


def _prepared_probes(
    options: RunOptions, recorder: SessionRecorder, application: str, default: float
) -> tuple[Path, Manifest, tuple[str, ...]] | None:
    """The sequence, the manifest and the probes to measure, ready; None where there are none, or the
    participant declines. Raises ClientError where they cannot be prepared."""
    server, home, console = recorder.server, recorder.home, recorder.console
    token = enrolment.current_token(home, server)
    if token is None:  # erased meanwhile
        return None
    assigned = probes.fetch(server, token, application)
    assigned.require_this_version()
    assigned.require_accepting()
    if not assigned.assigned:
        if why := line(assigned.assigned_message):
            console.say(f"No further configurations to measure: {why}")
        return None
    if not consent.is_agreed(home, server.url, assigned.consent_version):
        raise CannotMeasureError("the consent text has changed: the next `run` asks for your agreement")
    names = probes.select_fitting(assigned, default)
    console.lines(probes.describe(assigned, names))
    if not names or not (options.probes or console.ask(probes.question(names))):
        return None
    present = sequences.find_complete(assigned.sequence, home)
    path = present or _download(server, assigned, home, console, fresh=True)
    reference_trajectories.fetch(server, assigned, home)
    return path, assigned, names


def _select_runnable(
    names: tuple[str, ...], asked: Manifest, backend: str, console: Console
) -> tuple[str, ...]:
    """Those `names` that `backend` can run, with a note about the others; the protocol's own stay, and fail.

    Raises CannotMeasureError if none of `names` fits.
    """
    backends = {name: asked.by_name[name].backends for name in names}
    out = [name for name in preflight.unsupported(backends, backend) if name not in asked.protocol.order]
    if not out:
        return names
    if len(out) == 1:
        note = f"{out[0]} does not fit {NAMES[backend]} here and is left out"
    else:
        note = f"{', '.join(out[:-1])} and {out[-1]} do not fit {NAMES[backend]} here and are left out"
    fitting = tuple(name for name in names if name not in out)
    if not fitting:
        raise CannotMeasureError(f"{note}: nothing is left to measure")
    console.say(f"Note: {note}")
    return fitting


def _device(
    text: str | None, backend: str | None, application: str, root: Path
) -> tuple[Device, dict[str, str | None]]:
    """The device to use, and what this machine says of itself."""
    chosen = selection.choose(text, selection.backends_for(application, backend), root)
    return chosen, description.identify(root, processor=description.processor_identity(chosen))


def _ready(options: RunOptions, home: Home, console: Console, root: Path, download: int) -> None:
    concerns = preflight.concerns(home, root, download=download)
    for concern in preflight.require_fit(concerns, options.ignored):
        console.say(f"Note: {concern.text}")


def _ready_again(
    options: RunOptions,
    home: Home,
    console: Console,
    pause: Callable[[float], None],
    root: Path,
    most_pauses: int = COOLING_PAUSES,
) -> bool:
    """Whether another session can be measured after the device has cooled; the load of the previous one is
    ignored."""
    for pauses in range(most_pauses + 1):
        concerns = [concern for concern in preflight.concerns(home, root) if concern.name != preflight.LOAD]
        stopping = [concern for concern in concerns if concern.stops and concern.name not in options.ignored]
        if not stopping:
            return True
        if pauses == most_pauses or stopping[0].name != preflight.THROTTLING:
            break
        console.say(f"{stopping[0].text}; again in {COOLING_SECONDS:.0f} s")
        pause(COOLING_SECONDS)
    console.say(f"No further session: {stopping[0].text}")
    return False


def _consent(
    options: RunOptions,
    home: Home,
    console: Console,
    server: Server,
    asked: Manifest,
    chosen: Device,
    identity: dict[str, str | None],
) -> None:
    version = asked.consent_version
    if consent.is_agreed(home, server.url, version):
        return
    console.say(_consent_text(server, asked, chosen, identity, options.show_model))
    if not options.yes:
        if not console.can_ask:
            raise UsageError("no terminal to ask for agreement: read the text above, then add --yes")
        if not console.ask("Do you agree?"):
            raise CannotMeasureError("nothing was measured or sent: you did not agree")
    consent.remember(home, server.url, version)


def _consent_text(
    server: Server,
    asked: Manifest,
    chosen: Device,
    identity: dict[str, str | None],
    show_model: bool | None = None,
) -> str:
    sample = _sample_payload(asked, chosen, identity, show_model)
    return consent.text(server.url, asked.consent_version, sequences.size(asked.sequence), sample)


def _sample_payload(
    asked: Manifest, chosen: Device, identity: dict[str, str | None], show_model: bool | None
) -> dict[str, Any]:
    """An example payload of this device, with a run of two frames for brevity."""
    example = Run(
        *(uuid.uuid4(), "default", 0, 0, "ok", [31250, 30718]), stages_us={"tracking": [9120, 8980]},
        tracked=[True, True], ate_max=0.012, ate_mean=0.008, ate_rmse=0.009, cpu_us=59120, waited_us=140,
        deviation=0.0004,
    )  # fmt: skip
    shown = replace(
        begin(asked, chosen.backend, chosen.threads),
        started_at=datetime(2026, 1, 1, 12, tzinfo=UTC),
        runs=(example,),
        samples=[Sample(t=0.0, temperature_c=41.5, cpu_mhz=2400.0, battery=80.0)],
        empty_frame_us=212.5,
        stage_clock="device" if chosen.threads is None else "wall",
    )
    sample = payload(shown, asked, identity, show_model)
    for described in (*sample["sessions"], *sample["sessions"][0]["runs"]):
        described["id"] = "a random number"
    return sample


def _download(server: Server, asked: Manifest, home: Home, console: Console, fresh: bool) -> Path:
    _require_fresh(fresh, server, "sequence is")
    name = asked.sequence.name
    console.say(f"Downloading the sequence {name}, {sequences.size(asked.sequence) / 1e6:.1f} MB")
    return sequences.fetch(
        server,
        asked.sequence,
        home,
        progress=lambda done, total: console.bar(name, done // 1000, total // 1000, " kB"),
    )


def _require_fresh(fresh: bool, server: Server, what: str) -> None:
    if not fresh:
        raise CannotMeasureError(
            f"{server.url} does not answer and its {what} not stored here yet: try later"
        )
