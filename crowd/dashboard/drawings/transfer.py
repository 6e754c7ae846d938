"""Charts of transfer: similarity of devices, and the reference's fastest on each device."""

from dataclasses import dataclass, replace

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.content.transfer import PEARSON, SPEARMAN, coefficients, ordered, pairs
from crowd.dashboard.drawings.drawing import Drawing, Table, titled
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.transfer import (
    correlation_map,
    regret_bars,
    winner_bars,
)
from crowd.results.reading import selectors as results
from crowd.results.reading.transferring import correlations
from crowd.results.reading.transferring.rows import CorrelationMatrix, Winners
from wire.front import BEST

COUNTED = (
    "Only devices with confirmed figures of at least three configurations of the front, including the "
    "default, are counted."
)


@dataclass(frozen=True)
class Map:
    """A matrix, and the kind of coefficient to draw."""

    matrix: CorrelationMatrix
    kind: str


def kind_of(request: HttpRequest) -> str:
    """The kind ?correlation=, by default Pearson."""
    return SPEARMAN if request.GET.get("correlation") == SPEARMAN else PEARSON


def read_map(request: HttpRequest) -> Map:
    """The matrix under the filters of the query string."""
    return Map(correlations.correlation_matrix(results.parse_filters(request.GET)), kind_of(request))


def read_winners(request: HttpRequest) -> Winners:
    """The winners under the filters of the query string."""
    return results.winners(results.parse_filters(request.GET))


def map_table(shown: Map) -> Table:
    """A row per pair of devices, with both coefficients."""
    matrix = shown.matrix
    pearson, spearman = coefficients(matrix, PEARSON), coefficients(matrix, SPEARMAN)
    count = range(len(matrix.devices))
    return Table(
        ("device", "other_device", "configurations", "pearson_log_time", "spearman"),
        [
            (
                matrix.devices[first].slug,
                matrix.devices[second].slug,
                int(matrix.common[first, second]),
                float(pearson[first, second]),
                float(spearman[first, second]),
            )
            for first in count
            for second in count
            if first < second
        ],
    )


def winners_table(found: Winners) -> Table:
    """A row per device."""
    return Table.of(
        ordered(found.rows), "device=device.slug", "backend", "processor", "configurations", "fastest=winner",
        "fastest_speedup=speedup", "reference_speedup", "reference_rank",
        "reference_time_over_fastest=regret", "sessions",
    )  # fmt: skip


def _map_n(shown: Map) -> str:
    devices = formats.plural(len(shown.matrix.devices), "device")
    count = formats.plural(len(pairs(shown.matrix, shown.kind)), "pair")
    return f"{count} of {devices}{_others(shown.matrix)}"


def _winners_n(winners: Winners) -> str:
    return formats.plural(len(winners.rows), "device") + _others(winners)


def _judged_n(winners: Winners) -> str:
    return formats.plural(winners.judged, "device") + _others(winners)


def _others(result: Winners | CorrelationMatrix) -> str:
    """The number of devices left out because their figures are unconfirmed, in words."""
    count = result.unconfirmed
    return f"; not shown: {formats.plural(count, 'unconfirmed device')}" if count else ""


def _title(words: str, result: Winners | CorrelationMatrix) -> str:
    # All configurations and no suspect figures are used, whatever the filters are.
    return titled(words, result.front, replace(result.filters, configuration=BEST, suspect=True))


def _page() -> str:
    return reverse("dashboard:transfer")


DRAWINGS = (
    Drawing(
        name="transfer-correlation",
        path="transfer/correlation",
        definition="Correlation of two devices' times over the configurations that both measured: Pearson of "
        "logarithms, or Spearman of ranks. " + COUNTED,
        read=read_map,
        heat=True,
        draw=lambda shown, theme: correlation_map(shown.matrix, shown.kind, theme),
        table=map_table,
        title=lambda shown: _title("How alike devices are", shown.matrix),
        finding=lambda shown: findings.alike(pairs(shown.matrix, shown.kind).tolist(), shown.kind),
        n=_map_n,
        page=_page,
    ),
    Drawing(
        name="transfer-regret",
        path="transfer/best",
        definition="Time of the configuration that is the fastest on the reference device, over that of the "
        "fastest configuration measured on the device itself. " + COUNTED,
        read=read_winners,
        draw=lambda winners, theme: regret_bars(winners.rows, winners.reference, theme),
        table=winners_table,
        title=lambda winners: _title("The reference's fastest on each device", winners),
        finding=lambda winners: findings.regret(winners),
        n=_judged_n,
        page=_page,
    ),
    Drawing(
        name="transfer-winners",
        path="transfer/winners",
        definition="The configuration with the largest confirmed speedup on each device. " + COUNTED,
        read=read_winners,
        draw=lambda winners, theme: winner_bars(winners.counts, theme),
        table=winners_table,
        title=lambda winners: _title("Which configuration wins", winners),
        finding=lambda winners: findings.winners(winners.counts, len(winners.rows)),
        n=_winners_n,
        page=_page,
    ),
)
