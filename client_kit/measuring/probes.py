"""Probes: further configurations that the server assigns to this device."""

from collections.abc import Sequence
from statistics import fmean

from client_kit.delivery.manifest import Manifest, Protocol
from client_kit.delivery.server import Server
from client_kit.device.sources import line
from client_kit.measuring.session import Session
from wire.front import DEFAULT

# The time limit of a session of probes.
MINUTES = 2.0


def fetch(server: Server, token: str, application: str) -> Manifest:
    """The manifest of the probes that `server` assigns to this device. It is not stored.

    Raises the server's errors.
    """
    return Manifest.parse(server.assigned_manifest(token, application, MINUTES))


def default_seconds(session: Session, protocol: Protocol) -> float | None:
    """Mean seconds a frame of the default in `session`; None where it did not run."""
    times = [run.mean_seconds(protocol) for run in session.of(DEFAULT) if run.status == "ok"]
    return fmean(times) if times else None


def select_fitting(asked: Manifest, default: float) -> tuple[str, ...]:
    """The assigned configurations that fit into MINUTES on a device whose default takes `default` seconds a
    frame; the last ones are dropped if they do not fit."""
    names = [assigned.name for assigned in asked.assigned]
    while names and seconds(asked.plan(names), asked, default) > 60 * MINUTES:
        names.pop()
    return tuple(names)


def seconds(plan: Sequence[str], asked: Manifest, default: float) -> float:
    """The seconds of a session of `plan`: warm-up, runs and rests."""
    protocol = asked.protocol
    frame = {name: default * _time_ratio(asked, name) for name in plan}
    warm_up = protocol.warmup_frames * sum(frame.values())
    runs = protocol.frames * sum(frame[name] for name in plan)
    return warm_up + runs + protocol.rest_seconds * (len(plan) - 1)


def describe(asked: Manifest, names: Sequence[str]) -> list[str]:
    """The probes `names` with the server's reasons, and those left out for lack of time."""
    out = ", ".join(one.name for one in asked.assigned if one.name not in names)
    if not names:
        return [
            f"No further configurations are measured: {out} would take longer than {MINUTES:.0f} minutes."
        ]
    shown = ["", "The server assigns further configurations to this device:"]
    shown += [f"  {one.name}: {line(one.why) or ''}" for one in asked.assigned if one.name in names]
    return shown + ([f"Left out, as {MINUTES:.0f} minutes are too short: {out}"] if out else [])


def question(names: Sequence[str]) -> str:
    """The question to the participant before the probes `names` are measured."""
    noun = "configuration" if len(names) == 1 else "configurations"
    return f"Two more minutes improve the predictions for other devices. Measure {len(names)} more {noun}?"


def thanks(session: Session) -> str:
    """The line after a session of probes."""
    ran = dict.fromkeys(
        run.configuration for run in session.runs if run.status == "ok" and run.configuration != DEFAULT
    )
    if not ran:
        return "No probe ran here."
    return f"Thank you: predictions now include {', '.join(ran)} on this device."


def _time_ratio(asked: Manifest, name: str) -> float:
    """The predicted time of a frame over the default's; 1 where nothing is predicted."""
    if name == DEFAULT:
        return 1.0
    reference, predicted = asked.by_name[DEFAULT].predicted, asked.by_name[name].predicted
    if predicted.runtime_ratio:
        return predicted.runtime_ratio
    return predicted.runtime / reference.runtime if predicted.runtime and reference.runtime else 1.0
