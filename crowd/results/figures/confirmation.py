"""Who agrees with a figure beyond its own model: independent installations of other models with its chip.

A figure is confirmed by a quorum of independent networks. Those of its own model are counted when the figure
is computed; here the models with the same chip, backend and processor class are asked, where those are few.
"""

import math

from django.conf import settings
from django.db import transaction
from django.db.models import Avg, Q

from crowd.devices import revision
from crowd.results.figures import statistics
from crowd.results.models import DeviceSpeedup, SessionSummary, State

# configuration, backend, processor, processor class: what models share with one chip
Chip = tuple[int, str, str, str]
CHIP = ("configuration_id", "backend", "processor", "processor_class")
# More installations of one chip than this are not asked for: those of the figure's own model are enough then.
MOST = 20_000


def confirmed() -> Q:
    """Figures that a quorum of independent networks agrees with."""
    quorum = settings.FRONTRUNNER_QUORUM
    return Q(witnesses__gte=quorum) | Q(chip_witnesses__gte=quorum)


def settle(limit: int | None = None) -> int:
    """Ask the models with the same chip about figures that changed, at most LIMIT chips; how many."""
    unsettled = DeviceSpeedup.objects.filter(unsettled=True)
    chips = list(unsettled.order_by(*CHIP).values_list(*CHIP).distinct()[:limit])
    for chip in chips:
        _settle(chip)
    return len(chips)


@transaction.atomic
def _settle(chip: Chip) -> None:
    rows = DeviceSpeedup.objects.filter(**dict(zip(CHIP, chip, strict=True)))
    doubtful = rows.filter(witnesses__lt=settings.FRONTRUNNER_QUORUM, state=State.VALID)
    figures = list(doubtful.select_for_update().order_by("pk")) if _is_one_chip(chip[2]) else []
    found = _agreement(chip) if figures else None
    changed = 0
    for figure in figures:
        witnesses = found.witnesses(math.log(figure.speedup)) if found else 0
        if figure.chip_witnesses != witnesses:
            changed += rows.filter(pk=figure.pk).update(chip_witnesses=witnesses)
    others = rows.exclude(pk__in=[figure.pk for figure in figures]).exclude(chip_witnesses=0)
    changed += others.update(chip_witnesses=0)
    rows.filter(unsettled=True).update(unsettled=False)
    if changed:
        revision.bump()


def _is_one_chip(processor: str) -> bool:
    """Whether PROCESSOR names one chip and not a family of chips, as "Adreno" does, or an unknown one."""
    return any(letter.isdigit() for letter in processor)


def _agreement(chip: Chip) -> statistics.Agreement | None:
    """Which networks that measured CHIP agree; None where too many installations did."""
    configuration, backend, processor, processor_class = chip
    rows = SessionSummary.objects.filter(
        configuration=configuration,
        cohort__backend=backend,
        cohort__processor=processor,
        cohort__processor_class=processor_class,
        counted=True,
        state=State.VALID,
    )
    means = list(
        rows.order_by()
        .values_list("installation_id", "installation__network")
        .annotate(mean=Avg("log_ratio"))[: MOST + 1]
    )
    if len(means) > MOST:
        return None
    return statistics.agreement([network or None for _, network, _ in means], [mean for *_, mean in means])
