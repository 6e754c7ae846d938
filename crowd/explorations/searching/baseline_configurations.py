"""The configurations of an application that are known before any search."""

from typing import Any

from pareto import Space
from slam.kfusion.configuration import ANDROID_APP

DEFAULT = "default"
DEFAULT_OF_THE_APP = "STANDARD"


def baseline_configurations(application: str, space: Space) -> dict[str, dict[str, Any]]:
    """The known configurations by label. All speedups are relative to `default`.

    For kfusion, those of the published Android app; for others, the default of SPACE.
    """
    if application != "kfusion":
        return {DEFAULT: dict(space.default)}
    return {
        DEFAULT if name == DEFAULT_OF_THE_APP else name.lower(): configuration.to_dict()
        for name, configuration in ANDROID_APP.items()
    }
