"""Running the chosen configuration over a sequence, as an application on the device would."""

from pathlib import Path

from client_kit.choice import Point, device_of
from client_kit.device import description, selection
from client_kit.errors import CannotMeasureError, UsageError
from slam import benchmark
from slam.benchmark import Report
from slam.datasets import SequenceError, open_sequence
from slam.devices.device import Device, DeviceError
from slam.trajectories.trajectory import TrajectoryError


def run(
    point: Point,
    application: str,
    sequence: Path,
    device: tuple[str, str] | None = None,
    frames: int | None = None,
) -> Report:
    """Run `point` over `sequence`, in any format that `slam` reads, on the device of that name and platform.

    Raises UsageError for a sequence that cannot be read, CannotMeasureError where the device is gone or
    cannot run it.
    """
    try:
        opened = open_sequence(sequence)
        if device is None:
            chosen = selection.choose(backends=selection.backends_for(application))
        else:
            chosen = _present(device)
        return benchmark.run(
            point.parameters,
            opened,
            system=application,
            frames=frames,
            device=chosen.label,
            backend=chosen.backend,
        )
    except (SequenceError, TrajectoryError) as error:
        raise UsageError(f"--run {sequence}: {error}") from error
    except DeviceError as error:
        raise CannotMeasureError(str(error)) from error


def _present(device: tuple[str, str]) -> Device:
    """The device of that name and platform.

    Two platforms may offer the same processor with different times.
    """
    for present in selection.present():
        identity = description.identify(processor=description.processor_identity(present))
        if device_of({"device": identity}) == device:
            return present
    raise CannotMeasureError(f"{device[0]} ({device[1]}), for which it was chosen, is not here any more")


def lines(report: Report, max_ate: float, max_seconds: float | None) -> list[str]:
    """The result, and whether it kept the limits of the choice."""
    limit = ""
    if max_seconds is not None:
        side = "within" if report.runtime <= max_seconds else "above"
        limit = f", {side} the limit of {1000 * max_seconds:g} ms"
    texts = [
        f"{report.sequence['name']}, {len(report.frames)} frames: {1000 * report.runtime:.2f} ms a frame, "
        f"{1 / report.runtime:.1f} frames a second{limit}"
    ]
    lost = sum(frame.tracked is False for frame in report.frames)
    if lost:
        texts.append(f"tracking was lost in {lost} frames")
    if report.ate is None:
        texts.append("the sequence has no true trajectory: the error is unknown")
    else:
        kept = "within" if report.ate.max <= max_ate else "above"
        limit = f"{kept} the limit of {100 * max_ate:g} cm"
        texts.append(f"largest trajectory error {100 * report.ate.max:.2f} cm, {limit}")
    return texts
