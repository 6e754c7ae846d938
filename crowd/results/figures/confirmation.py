"""Who agrees with a figure beyond its own model: independent installations of other models with its chip.

A figure is confirmed by a quorum of independent networks. Those of its own model are counted when the figure
is computed; here the models with the same chip, backend and processor class are asked, where those are few.

Names of models can be invented, and a chip would confirm each of them. So a network supports one figure of a
configuration at most that its chip confirms, and such a figure needs a network that supports no other.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence

from django.conf import settings
from django.db import transaction
from django.db.models import Avg, Q

from crowd.devices import chips, revision
from crowd.results.figures import statistics
from crowd.results.models import DeviceSpeedup, SessionSummary, State
from crowd.results.validity.measures import AGREEMENT

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


def settle() -> None:
    """Ask the models with the same chip about figures that changed."""
    unsettled = DeviceSpeedup.objects.filter(unsettled=True)
    chips = list(unsettled.order_by(*CHIP).values_list(*CHIP).distinct())
    for chip in chips:
        _settle(chip)


@transaction.atomic
def _settle(chip: Chip) -> None:
    quorum = settings.FRONTRUNNER_QUORUM
    rows = DeviceSpeedup.objects.filter(**dict(zip(CHIP, chip, strict=True)))
    # First of all: a figure that changes from here on waits for the end of this transaction.
    rows.filter(unsettled=True).update(unsettled=False)
    doubtful = rows.filter(witnesses__lt=quorum, state=State.VALID)
    figures = list(doubtful.select_for_update().order_by("pk")) if chips.is_one_chip(chip[2]) else []
    changed = released = 0
    for figure, witnesses in _chip_witnesses(chip, figures):
        if figure.chip_witnesses != witnesses:
            changed += rows.filter(pk=figure.pk).update(chip_witnesses=witnesses)
            released += figure.chip_witnesses >= quorum > witnesses
    others = rows.exclude(pk__in=[figure.pk for figure in figures]).exclude(chip_witnesses=0)
    released += others.filter(chip_witnesses__gte=quorum).count()
    changed += others.update(chip_witnesses=0)
    if released:
        ask_again([chip[0]])
    if changed:
        revision.bump()


def _chip_witnesses(chip: Chip, figures: Sequence[DeviceSpeedup]) -> Iterator[tuple[DeviceSpeedup, int]]:
    """Each of FIGURES with the number of networks that agree, of those that measured CHIP. Three queries."""
    if not figures:
        return
    measured = _measured(chip)
    agreement = statistics.agreement(
        [network or None for _, network, _ in measured], [log for *_, log in measured]
    )
    networks_of: dict[int, set[str]] = defaultdict(set)
    for device, network, _ in measured:
        if network:
            networks_of[device].add(network)
    supported = _supported(chip[0], {name for figure in figures for name in networks_of[figure.device_id]})
    for figure in figures:
        networks, key = networks_of[figure.device_id], _key(figure)
        free = any(supported[network] <= {key} for network in networks)
        witnesses = agreement.witnesses(math.log(figure.speedup), AGREEMENT) if free else 0
        for network in networks:
            if witnesses >= settings.FRONTRUNNER_QUORUM:
                supported[network].add(key)
            else:
                supported[network].discard(key)
        yield figure, witnesses


def ask_again(configurations: Collection[int]) -> None:
    """Let the chips of unconfirmed figures of CONFIGURATIONS be asked again: a figure that its chip confirmed
    is gone or needs that no more, so its networks may support another.
    """
    quorum = settings.FRONTRUNNER_QUORUM
    DeviceSpeedup.objects.filter(
        configuration__in=configurations, state=State.VALID, witnesses__lt=quorum, chip_witnesses__lt=quorum
    ).update(unsettled=True)


def _key(figure: DeviceSpeedup) -> FigureKey:
    return figure.device_id, figure.backend, figure.processor, figure.processor_class


def _supported(configuration: int, networks: Collection[str]) -> dict[str, set[FigureKey]]:
    """Which figures of CONFIGURATION that their chip confirms each of NETWORKS measured. Two queries."""
    found: dict[str, set[FigureKey]] = defaultdict(set)
    quorum = settings.FRONTRUNNER_QUORUM
    confirmed_by_chip = DeviceSpeedup.objects.filter(
        configuration=configuration, witnesses__lt=quorum, chip_witnesses__gte=quorum, state=State.VALID
    )
    keys = {_key(figure) for figure in confirmed_by_chip}
    if not keys or not networks:
        return found
    rows = SessionSummary.objects.filter(
        configuration=configuration, counted=True, state=State.VALID, installation__network__in=networks
    )
    measured = rows.order_by().values_list(
        "installation__network",
        "cohort__device_id",
        "cohort__backend",
        "cohort__processor",
        "cohort__processor_class",
    )
    for network, *columns in measured.distinct():
        if (key := tuple(columns)) in keys:
            found[network].add(key)
    return found


def _measured(chip: Chip) -> list[tuple[int, str, float]]:
    """Device, network and mean log ratio of each installation that measured CHIP; none where too many did."""
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
        .values_list("cohort__device_id", "installation__network", "installation_id")
        .annotate(mean=Avg("log_ratio"))[: MOST + 1]
    )
    return [] if len(means) > MOST else [(device, network, mean) for device, network, _, mean in means]
