"""All drawings. A new drawing is an entry in DRAWINGS of its module."""

from typing import Any

from crowd.dashboard.drawings import (
    comparison,
    devices,
    explorations,
    fronts,
    groups,
    predictions,
    sessions,
    speedups,
    surface,
    transfer,
)
from crowd.dashboard.drawings.drawing import Drawing

DRAWINGS: tuple[Drawing[Any], ...] = (
    *speedups.DRAWINGS,
    *groups.DRAWINGS,
    *comparison.DRAWINGS,
    *devices.DRAWINGS,
    *predictions.DRAWINGS,
    *sessions.DRAWINGS,
    *fronts.DRAWINGS,
    *explorations.DRAWINGS,
    *surface.DRAWINGS,
    *transfer.DRAWINGS,
)
