"""Preparations: each point of a draft runs on every device of a machine, then all are timed in turn.

A preparation is an exploration that searches nothing. So its measurements are leased, returned, cancelled and
exported as all others, and each is stored as it is done.
"""

from collections.abc import Sequence
from typing import Any

from django.core.exceptions import ValidationError
from django.db import transaction
from django.utils import timezone

from crowd.explorations.measuring import reference_devices
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.preparing import prepared_front
from crowd.explorations.preparing.prepared_front import Measured, NotPreparableError
from crowd.explorations.searching.batches import configuration_digest
from crowd.fronts import selectors
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts
from slam.references import times
from wire.front import DEFAULT, Front, Point

MOST_DISTURBED = 4  # runs of a point in a round, after which somebody is asked to end other programs
Phase, State = Evaluation.Phase, Evaluation.State
UNFINISHED = (State.PENDING, State.RUNNING)


@transaction.atomic
def create(front: FrontVersion, device: ReferenceDevice | None = None) -> Exploration:
    """A preparation of the draft `front`, with the first measurements; the unfinished one if there is one.

    `device` times the points: by default the reference device that measured them, or this machine. Raises
    ValidationError if `front` is not a draft.
    """
    stored = FrontVersion.objects.select_for_update().get(pk=front.pk)
    if stored.state != FrontVersion.State.DRAFT:
        raise ValidationError(
            f"{stored.slug} is {stored.get_state_display()}: only a draft can be prepared, because it changes"
        )
    unfinished = (Exploration.State.RUNNING, Exploration.State.PAUSED)
    earlier = stored.preparations.filter(state__in=unfinished, prepares_digest=stored.digest).first()
    if earlier is not None:
        return earlier
    content = selectors.front_in_any_state(stored.pk)
    points = (*content.points, *content.probes)
    preparation = Exploration.objects.create(
        application=stored.application,
        space=_space(stored.application, points),
        sequence=stored.sequence["name"],
        sequence_sha256=stored.sequence["sha256"],
        reference_device=device or _device(content),
        objectives=["ate_max", "runtime"],
        budget=len(points),
        frames=content.protocol.frames,
        prepares=stored,
        prepares_digest=stored.digest,
    )
    _add(preparation, Phase.REFERENCE, points, 0)
    return preparation


def latest(front: FrontVersion) -> Exploration | None:
    """The newest preparation of `front`, or None."""
    return front.preparations.select_related("reference_device").order_by("-pk").first()


@transaction.atomic
def advance(key: int) -> list[Evaluation]:
    """Add the next measurements of the preparation with that key, or complete its draft. Returns them.

    If the draft cannot be published, the preparation pauses with the reason in its note.
    """
    preparation = Exploration.objects.select_for_update().get(pk=key)
    rows = list(preparation.evaluations.order_by("number"))
    if preparation.state != Exploration.State.RUNNING or any(row.state in UNFINISHED for row in rows):
        return []
    assert preparation.prepares is not None
    front = selectors.front_in_any_state(preparation.prepares.pk)
    try:
        if wanted := _next(preparation, front, rows):
            return wanted
        document = prepared_front.document(front, _measured(rows))
        fronts.complete_draft(preparation.prepares, preparation.prepares_digest, document)
    except (NotPreparableError, *fronts.REFUSALS) as error:
        preparation.state, preparation.note = Exploration.State.PAUSED, str(error)
        preparation.save(update_fields=["state", "note"])
    else:
        preparation.state, preparation.finished_at = Exploration.State.DONE, timezone.now()
        preparation.save(update_fields=["state", "finished_at"])
    return []


def _next(preparation: Exploration, front: Front, rows: Sequence[Evaluation]) -> list[Evaluation]:
    """New rows: references by an earlier program again, then the next round of times."""
    by_name = {point.name: point for point in (*front.points, *front.probes)}
    measured = _measured(rows)
    outdated = [
        point
        for name, point in by_name.items()
        if name in measured.references and measured.references[name]["program"] != _program(front, point)
    ]
    if outdated:
        return _add(preparation, Phase.REFERENCE, outdated, 0)
    prepared_front.check_references(front, measured)
    if DEFAULT in measured.failed:
        raise NotPreparableError(f"{DEFAULT} cannot be timed: {measured.failed[DEFAULT]}")
    if again := times.open_round(measured.timed):
        number, ran = again
        most = max(ran.values())
        disturbed = f"other programs disturbed {', '.join(ran)} in round {number + 1}, {most} times"
        reason = f"{disturbed}: end them, then resume"
        if most % MOST_DISTURBED == 0 and preparation.note != reason:
            raise NotPreparableError(reason)
        Exploration.objects.filter(pk=preparation.pk).update(note="")
        return _add(preparation, Phase.TIME, [by_name[name] for name in times.with_default(ran)], number)
    left = measured.without_reference(front)
    relative_times = times.relative(measured.runs)
    done = 1 + max((run.round for run in measured.runs), default=-1)
    points, probes = (
        [point.name for point in part if point.name not in left and point.name not in measured.failed]
        for part in (front.points, front.probes)
    )
    wanted = times.next_round(relative_times, points, probes, done)
    return _add(preparation, Phase.TIME, [by_name[name] for name in wanted], done)


def _program(front: Front, point: Point) -> str | None:
    return plans.program_digest(front.application, front.sequence["sha256"], point.parameters)


def _measured(rows: Sequence[Evaluation]) -> Measured:
    """What `rows` say of the points by their names. A later reference replaces an earlier one."""
    references, timed, failed = {}, [], {}
    for row in rows:
        if row.state == State.FAILED:
            failed[row.label] = row.error
        elif row.phase == Phase.REFERENCE:
            references[row.label] = row.reference or {}
        else:
            values = row.objectives or {}
            clocks = values.get("cpu_seconds"), values.get("waited_seconds")
            timed.append(times.Timed(row.iteration, row.label, values["runtime"], row.stages or {}, *clocks))
    by_device = next((row for row in reversed(rows) if row.phase == Phase.TIME and row.device), None)
    device = {} if by_device is None else by_device.device or {}
    return Measured(references, timed, failed, device, rows[-1].software)


def _add(preparation: Exploration, phase: str, points: Sequence[Point], iteration: int) -> list[Evaluation]:
    first = preparation.evaluations.count()
    return Evaluation.objects.bulk_create(
        Evaluation(
            exploration=preparation,
            number=first + offset,
            phase=phase,
            label=point.name,
            configuration=point.parameters,
            configuration_key=configuration_digest(point.parameters),
            iteration=iteration,
            frames=preparation.frames,
        )
        for offset, point in enumerate(points)
    )


def _device(front: Front) -> ReferenceDevice:
    """The reference device that measured `front`, if it is known here; else this machine."""
    name = front.provenance.get("reference_device", "")
    named = ReferenceDevice.objects.filter(name=name, elsewhere="").first()
    return named or reference_devices.create_this_machine()


def _space(application: str, points: Sequence[Point]) -> dict[str, Any]:
    """A space of just the values of `points`, with the default's as its default."""
    default = next(point for point in points if point.name == DEFAULT).parameters
    values = {
        name: {point.parameters.get(name, value) for point in points} for name, value in default.items()
    }
    return {
        "name": application,
        "parameters": [
            {
                "name": name,
                "type": "boolean" if isinstance(default[name], bool) else "ordinal",
                "values": [False, True] if isinstance(default[name], bool) else sorted(occurring),
                "default": default[name],
            }
            for name, occurring in values.items()
        ],
    }
