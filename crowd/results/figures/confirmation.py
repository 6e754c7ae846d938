"""Who agrees with a figure beyond its own model: independent installations of other models with its chip.

A figure is confirmed by a quorum of independent networks. Those of its own model are counted when the figure
is computed; here the models with the same chip, backend and processor class are asked, where those are few.

Names of models can be invented, and a chip would confirm each of them. So a network supports one figure of a
configuration at most that its chip confirms, and such a figure needs a network that supports no other.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Sequence

from django.conf import settings
from django.db import transaction
from django.db.models import Avg, Q, QuerySet

from crowd.devices import revision
from crowd.results.figures import statistics
from crowd.results.models import DeviceSpeedup, SessionSummary, State

# configuration, backend, processor, processor class: what models share with one chip
Chip = tuple[int, str, str, str]
CHIP = ("configuration_id", "backend", "processor", "processor_class")
# device, backend, processor, processor class: what figures of one configuration differ in
FigureKey = tuple[int, str, str, str]
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
    quorum = settings.FRONTRUNNER_QUORUM
    rows = DeviceSpeedup.objects.filter(**dict(zip(CHIP, chip, strict=True)))
    doubtful = rows.filter(witnesses__lt=quorum, state=State.VALID)
    figures = list(doubtful.select_for_update().order_by("pk")) if _is_one_chip(chip[2]) else []
    found = _agreement(chip) if figures else None
    witnesses = {figure: found.witnesses(math.log(figure.speedup)) if found else 0 for figure in figures}
    witnesses |= dict.fromkeys(
        _without_network(chip, [each for each in figures if witnesses[each] >= quorum]), 0
    )
    changed = released = 0
    for figure, count in witnesses.items():
        if figure.chip_witnesses != count:
            changed += rows.filter(pk=figure.pk).update(chip_witnesses=count)
            released += figure.chip_witnesses >= quorum > count
    others = rows.exclude(pk__in=[figure.pk for figure in figures]).exclude(chip_witnesses=0)
    released += others.filter(chip_witnesses__gte=quorum).count()
    changed += others.update(chip_witnesses=0)
    rows.filter(unsettled=True).update(unsettled=False)
    if released:
        ask_again([chip[0]])
    if changed:
        revision.bump()


def ask_again(configurations: Collection[int]) -> None:
    """Let the chips of unconfirmed figures of CONFIGURATIONS be asked again: a figure that its chip confirmed
    is gone or needs that no more, so its networks may support another.
    """
    quorum = settings.FRONTRUNNER_QUORUM
    DeviceSpeedup.objects.filter(
        configuration__in=configurations, state=State.VALID, witnesses__lt=quorum, chip_witnesses__lt=quorum
    ).update(unsettled=True)


def _without_network(chip: Chip, figures: Sequence[DeviceSpeedup]) -> list[DeviceSpeedup]:
    """Those of FIGURES, which CHIP would confirm, all of whose networks support another figure already."""
    networks = _networks(chip, [figure.device_id for figure in figures])
    supported = _supported(chip, set().union(*networks.values()))
    refused = []
    # Those that are confirmed already stay so.
    for figure in sorted(figures, key=lambda each: each.chip_witnesses < settings.FRONTRUNNER_QUORUM):
        own = networks[figure.device_id]
        if any(supported[network] <= {_key(figure)} for network in own):
            for network in own:
                supported[network].add(_key(figure))
        else:
            refused.append(figure)
    return refused


def _key(figure: DeviceSpeedup) -> FigureKey:
    return figure.device_id, figure.backend, figure.processor, figure.processor_class


def _networks(chip: Chip, devices: Collection[int]) -> dict[int, set[str]]:
    """The known networks from which each of DEVICES was measured with CHIP. One query, none for no device."""
    found: dict[int, set[str]] = defaultdict(set)
    rows = _measured(chip).filter(cohort__device__in=devices).exclude(installation__network="")
    for device, network in rows.values_list("cohort__device_id", "installation__network").distinct():
        found[device].add(network)
    return found


def _supported(chip: Chip, networks: Collection[str]) -> dict[str, set[FigureKey]]:
    """Which figures with other chips than CHIP, confirmed by these, each of NETWORKS measured."""
    found: dict[str, set[FigureKey]] = defaultdict(set)
    quorum = settings.FRONTRUNNER_QUORUM
    confirmed_by_chip = DeviceSpeedup.objects.filter(
        configuration=chip[0], witnesses__lt=quorum, chip_witnesses__gte=quorum, state=State.VALID
    )
    keys = {_key(figure) for figure in confirmed_by_chip} if networks else set()
    keys -= {key for key in keys if key[1:] == chip[1:]}
    if not keys:
        return found
    rows = SessionSummary.objects.filter(
        configuration=chip[0], counted=True, state=State.VALID, installation__network__in=networks
    )
    cohort = (f"cohort__{name}" for name in ("device_id", "backend", "processor", "processor_class"))
    for network, *columns in rows.order_by().values_list("installation__network", *cohort).distinct():
        if (key := tuple(columns)) in keys:
            found[network].add(key)
    return found


def _is_one_chip(processor: str) -> bool:
    """Whether PROCESSOR names one chip and not a family of chips, as "Adreno" does, or an unknown one."""
    return any(letter.isdigit() for letter in processor)


def _measured(chip: Chip) -> QuerySet[SessionSummary]:
    """The summaries of CHIP that count."""
    configuration, backend, processor, processor_class = chip
    return SessionSummary.objects.filter(
        configuration=configuration,
        cohort__backend=backend,
        cohort__processor=processor,
        cohort__processor_class=processor_class,
        counted=True,
        state=State.VALID,
    ).order_by()


def _agreement(chip: Chip) -> statistics.Agreement | None:
    """Which networks that measured CHIP agree; None where too many installations did."""
    means = list(
        _measured(chip)
        .values_list("installation_id", "installation__network")
        .annotate(mean=Avg("log_ratio"))[: MOST + 1]
    )
    if len(means) > MOST:
        return None
    return statistics.agreement([network or None for _, network, _ in means], [mean for *_, mean in means])
