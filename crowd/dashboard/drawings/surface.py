"""Charts of the shipped response surfaces: time and error over two parameters."""

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.content.citation import SHIPPED
from crowd.dashboard.content.surface import Surface, chosen, rows
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.figures.surfaces import surface_map
from crowd.dashboard.responses import or_404


def read(request: HttpRequest) -> Surface:
    return or_404(chosen(request.GET.get("application", "")))


def cells_table(surface: Surface) -> Table:
    """A row per cell."""
    return Table(
        (surface.x, surface.y, "runtime_s", "runtime_sd_s", "ate_max_m", "ate_max_sd_m", "rounds", "valid"),
        [
            (x, row.y, *runtime, *ate_max, surface.rounds, bool(valid))
            for row, valids in zip(rows(surface), surface.valid, strict=True)
            for x, runtime, ate_max, valid in zip(
                surface.x_values, row.runtime, row.ate_max, valids, strict=True
            )
        ],
    )


def _title(what: str, surface: Surface) -> str:
    axes = f"{formats.words(surface.x)} and {formats.words(surface.y)}"
    return f"{what} of {formats.application(surface.application)} over {axes}"


def _n(surface: Surface) -> str:
    return f"{formats.plural(surface.runtime.size, 'configuration')}, each measured {surface.repeats}"


def _page() -> str:
    return reverse("dashboard:surface")


DRAWINGS = (
    Drawing(
        name="surface-runtime",
        path="surface/runtime",
        definition="Mean computation time a frame on one device; every other parameter keeps one value.",
        read=read,
        heat=True,
        draw=lambda surface, theme: surface_map(surface, "runtime", theme),
        table=cells_table,
        title=lambda surface: _title("Time a frame", surface),
        n=_n,
        page=_page,
        origin=SHIPPED,
    ),
    Drawing(
        name="surface-error",
        path="surface/error",
        definition="Largest distance between the estimated and the true trajectory; every other parameter "
        "keeps one value.",
        read=read,
        heat=True,
        draw=lambda surface, theme: surface_map(surface, "ate_max", theme),
        table=cells_table,
        title=lambda surface: _title("Trajectory error", surface),
        n=_n,
        page=_page,
        origin=SHIPPED,
    ),
)
