"""Confirms figures by other device models with the same chip.

A quorum of independent networks confirms a figure. The networks of its own model are counted when the figure
is computed. If they are too few, this module counts the networks that measured other models with the same
chip, backend and processor class.

Model names can be invented, and a chip would confirm all of them. So for each configuration, a network
supports at most one figure that its chip confirms, and such a figure needs a network that supports no other.
Only networks that measured models with known names are counted for other models.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence

from django.conf import settings
from django.db import transaction
from django.db.models import Avg, Q

from crowd.devices import revision
from crowd.devices.naming import chips
from crowd.results.figures import statistics
from crowd.results.models import DeviceSpeedup, SessionSummary, State
from crowd.results.validity.measures import AGREEMENT

# configuration, backend, processor, processor class: the same for all models with one chip
Chip = tuple[int, str, str, str]
CHIP_COLUMNS = ("configuration_id", "backend", "processor", "processor_class")
# device, backend, processor, processor class: identifies a figure of one configuration
ModelFigureKey = tuple[int, str, str, str]
# A chip with more installations is skipped: its models have enough of their own.
MAX_INSTALLATIONS = 20_000


def confirmed() -> Q:
    """Selects figures that a quorum of independent networks confirms."""
    quorum = settings.FRONTRUNNER_QUORUM
    return Q(witnesses__gte=quorum) | Q(chip_witnesses__gte=quorum)


def update_chip_witnesses() -> None:
    """Count the networks of the same chip for figures that changed."""
    unsettled = DeviceSpeedup.objects.filter(unsettled=True)
    chips = list(unsettled.order_by(*CHIP_COLUMNS).values_list(*CHIP_COLUMNS).distinct())
    for chip in chips:
        _update_chip(chip)


@transaction.atomic
def _update_chip(chip: Chip) -> None:
    quorum = settings.FRONTRUNNER_QUORUM
    rows = DeviceSpeedup.objects.filter(**dict(zip(CHIP_COLUMNS, chip, strict=True)))
    # First, so that a figure that changes from now on waits for the end of this transaction.
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
        mark_doubtful_unsettled([chip[0]])
    if changed:
        revision.bump()


def _chip_witnesses(chip: Chip, figures: Sequence[DeviceSpeedup]) -> Iterator[tuple[DeviceSpeedup, int]]:
    """Each of `figures` with how many networks that measured `chip` agree with it. Three queries."""
    if not figures:
        return
    measured = _chip_measurements(chip)
    measurements = [(network or None, log) for _, network, named, log in measured if named]
    agreement = statistics.agreement(
        [network for network, _ in measurements], [log for _, log in measurements]
    )
    networks_of: dict[int, set[str]] = defaultdict(set)
    for device, network, *_ in measured:
        if network:
            networks_of[device].add(network)
    supported = _supported_figures(
        chip[0], {name for figure in figures for name in networks_of[figure.device_id]}
    )
    for figure in figures:
        networks, key = networks_of[figure.device_id], _figure_key(figure)
        free = any(supported[network] <= {key} for network in networks)
        witnesses = agreement.witnesses(math.log(figure.speedup), AGREEMENT) if free else 0
        for network in networks:
            if witnesses >= settings.FRONTRUNNER_QUORUM:
                supported[network].add(key)
            else:
                supported[network].discard(key)
        yield figure, witnesses


def mark_doubtful_unsettled(configurations: Collection[int]) -> None:
    """Let the figures of `configurations` that need their chip be checked again.

    Call it when a figure is gone: others may lose it as a witness. Or when one does not need its chip any
    more: its networks may support another figure.
    """
    DeviceSpeedup.objects.filter(
        configuration__in=configurations, state=State.VALID, witnesses__lt=settings.FRONTRUNNER_QUORUM
    ).update(unsettled=True)


def _figure_key(figure: DeviceSpeedup) -> ModelFigureKey:
    return figure.device_id, figure.backend, figure.processor, figure.processor_class


def _supported_figures(configuration: int, networks: Collection[str]) -> dict[str, set[ModelFigureKey]]:
    """The figures of `configuration`, confirmed by chip, that each of `networks` measured. Two queries."""
    figures: dict[str, set[ModelFigureKey]] = defaultdict(set)
    quorum = settings.FRONTRUNNER_QUORUM
    confirmed_by_chip = DeviceSpeedup.objects.filter(
        configuration=configuration, witnesses__lt=quorum, chip_witnesses__gte=quorum, state=State.VALID
    )
    keys = {_figure_key(figure) for figure in confirmed_by_chip}
    if not keys or not networks:
        return figures
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
            figures[network].add(key)
    return figures


def _chip_measurements(chip: Chip) -> list[tuple[int, str, bool, float]]:
    """What each installation that measured `chip` measured; empty for too many.

    Device, network, whether the model's name is known, mean log ratio.
    """
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
        .values_list("cohort__device_id", "installation__network", "cohort__device__named", "installation_id")
        .annotate(mean=Avg("log_ratio"))[: MAX_INSTALLATIONS + 1]
    )
    return (
        []
        if len(means) > MAX_INSTALLATIONS
        else [(device, network, named, mean) for device, network, named, _, mean in means]
    )
