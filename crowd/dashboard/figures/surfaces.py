"""Heat maps of response surfaces: a quantity over the values of two parameters."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.surface import Repeated, Surface, rows
from crowd.dashboard.figures.elements import heat, layout
from crowd.dashboard.figures.palette import Theme

# By attribute of a surface: the title, and the factor from SI units.
QUANTITIES = {
    "runtime": ("ms a frame (log)", 1e3),
    "ate_max": ("maximum trajectory error, cm (log)", 100.0),
}

LETTER = 8  # pixels, of a name on the axis
LYING = 480  # pixels, for the names across on pages that are not narrow
LEAST_GAP = 0.3  # between ticks of the scale of colours, as a share of it


def surface_height(surface: Surface) -> int:
    """Pixels that surface_map needs."""
    return 150 + heat.ROW * len(surface.y_values)


def surface_map(surface: Surface, quantity: str, theme: Theme) -> go.Figure:
    """`quantity` (of QUANTITIES) over both parameters, on a logarithmic scale of colours.

    Values of parameters are at equal distances. Cells with an invalid trajectory have a cross; cells that the
    device could not run are blank.
    """
    title, scale = QUANTITIES[quantity]
    values: NDArray[np.float64] = getattr(surface, quantity) * scale
    figure = layout.blank(theme, surface_height(surface))
    finite = values[np.isfinite(values)]
    if not finite.size:
        return layout.note(figure, "Nothing could be measured", theme)
    ticks = _apart(layout.log_ticks(float(finite.min()), float(finite.max())))
    heat.add_cells(
        figure,
        np.log10(values),
        _hover(surface),
        theme,
        colorbar=heat.bar(
            theme,
            title,
            tickvals=[float(np.log10(tick)) for tick in ticks],
            ticktext=[f"{t:g}" for t in ticks],
        ),
    )
    invalid = np.argwhere(~surface.valid & np.isfinite(surface.ate_max))
    if len(invalid):
        figure.add_scatter(
            x=invalid[:, 1].tolist(),
            y=invalid[:, 0].tolist(),
            mode="markers",
            marker={"symbol": "x", "size": 9, "color": theme.limit},
            hoverinfo="skip",
            showlegend=False,
        )
    across = [f"{value:g}" for value in surface.x_values]
    lying = LETTER * sum(len(name) + 1 for name in across) < LYING
    return figure.update_layout(
        # The angle is fixed: plotly puts the title where names would end at the angle that it expects.
        xaxis=heat.named_axis(across, formats.words(surface.x)) | {"tickangle": 0 if lying else -90},
        yaxis=heat.named_axis([f"{value:g}" for value in surface.y_values], formats.words(surface.y)),
        margin={"t": 64},
        meta={"narrow": {"xaxis.tickangle": -90}},
    )


def _apart(ticks: list[float]) -> list[float]:
    """Those of `ticks` that keep apart on a scale of colours as long as a phone has room for."""
    kept = ticks[:1]
    for tick in ticks[1:]:
        if tick / kept[-1] >= (ticks[-1] / ticks[0]) ** LEAST_GAP:
            kept.append(tick)
    return kept


def _hover(surface: Surface) -> list[list[str]]:
    return [
        [
            layout.lines(
                [
                    f"<b>{formats.words(surface.x)} {x:g}, {formats.words(surface.y)} {row.y:g}</b>",
                    f"{_spread(formats.milliseconds, runtime)} a frame",
                    f"max ATE {_spread(formats.centimetres, ate_max)}",
                ]
            )
            for x, runtime, ate_max in zip(surface.x_values, row.runtime, row.ate_max, strict=True)
        ]
        for row in rows(surface)
    ]


def _spread(write: Callable[[float | None], str], cell: Repeated) -> str:
    deviation = "" if cell.deviation is None else f" \N{PLUS-MINUS SIGN} {write(cell.deviation)}"
    return write(cell.mean) + deviation
