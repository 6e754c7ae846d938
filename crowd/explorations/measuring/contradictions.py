"""Sets a reference device aside whose answers contradict: the same configuration, measured again, differs.

A lease does not say that its configuration was measured before. Errors are compared with those of any device,
times only where the device and its description are the same.
"""

from django.db import transaction

from crowd.audit.services import record
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.searching.ratios import COPIED

THIS_SERVER = "server"
# Devices round differently and machines are disturbed: smaller differences contradict nothing.
FACTOR, LEAST_ERROR = 2.0, 0.05  # m


def compare(evaluation: Evaluation) -> None:
    """Compare the stored answer of `evaluation`, if it is a check. A contradiction sets devices aside."""
    if evaluation.phase != Evaluation.Phase.CHECK:
        return
    new = Evaluation.objects.select_related("exploration__reference_device").get(pk=evaluation.pk)
    if new.state != Evaluation.State.DONE:
        return
    for other in _same_measurements(new):
        if differing := contradiction(new, other):
            _set_aside(new, other, differing)
            return


def contradiction(new: Evaluation, other: Evaluation) -> str:
    """What contradicts between two measurements of one configuration; empty if nothing does."""
    same_device = new.device == other.device and (
        new.exploration.reference_device_id == other.exploration.reference_device_id
    )
    now, before = new.objectives or {}, other.objectives or {}
    for name in sorted(now.keys() & before.keys()):
        least, most = sorted((now[name], before[name]))
        is_error = name.startswith("ate_")
        counts = most - least > LEAST_ERROR if is_error else same_device and name == "runtime"
        if counts and most > FACTOR * least:
            return f"{name} {now[name]:.3g} {'m' if is_error else 's'}, before {before[name]:.3g}"
    return ""


def _same_measurements(new: Evaluation) -> list[Evaluation]:
    """The earlier measurements of the configuration of `new`, over the same frames of the same sequences."""
    search = new.exploration
    rows = Evaluation.objects.filter(
        configuration_key=new.configuration_key,
        state=Evaluation.State.DONE,
        frames=new.frames,
        perturbation=new.perturbation,
        censored=[],
        exploration__application=search.application,
        exploration__sequence_sha256=search.sequence_sha256,
        exploration__further_sequences=search.further_sequences,
        exploration__error_quantile=search.error_quantile,
        exploration__reference_device__elsewhere="",
    ).exclude(pk=new.pk)
    return list(rows.exclude(phase__in=COPIED).select_related("exploration__reference_device"))


@transaction.atomic
def _set_aside(new: Evaluation, other: Evaluation, differing: str) -> None:
    """Either answer may be wrong, so that every device of them that measures over HTTP waits for a person."""
    devices = {each.exploration.reference_device for each in (new, other)}
    reason = f"its answers contradict: {new} has {differing} in {other}"
    for device in devices:
        if device.token_sha256 and not device.set_aside:
            ReferenceDevice.objects.filter(pk=device.pk).update(set_aside=reason)
            record(THIS_SERVER, "set aside", f"reference device {device.name}", reason)
            running = Exploration.objects.filter(reference_device=device, state=Exploration.State.RUNNING)
            running.update(note=f"{device} is set aside, because {reason}")
