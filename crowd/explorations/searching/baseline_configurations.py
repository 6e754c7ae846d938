"""The configurations of an application that are known before any search."""

from typing import Any

from pareto import Space
from slam.definitions import SYSTEMS, without_optional

DEFAULT = "default"
DEFAULT_OF_THE_APP = "STANDARD"


def baseline_configurations(application: str, space: Space) -> dict[str, dict[str, Any]]:
    """The known configurations by label. All speedups are relative to `default`.

    For kfusion, those of the published Android app; for others, the default of `space`.
    """
    known = SYSTEMS[application].known if application in SYSTEMS else {}
    if not known:
        return {DEFAULT: without_optional(space.default)}
    return {
        DEFAULT if name == DEFAULT_OF_THE_APP else name.lower(): dict(configuration)
        for name, configuration in known.items()
    }
