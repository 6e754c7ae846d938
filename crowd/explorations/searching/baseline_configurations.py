"""Configurations of an application that were known before any search."""

from typing import Any

from pareto import Space
from slam.kfusion.configuration import ANDROID_APP

DEFAULT = "default"
DEFAULT_OF_THE_APP = "STANDARD"


def configurations(application: str, space: Space) -> dict[str, dict[str, Any]]:
    """The known configurations by label, the one that every speedup is measured against as `default`.

    For kfusion those of the published Android app; for any other the space's own default.
    """
    if application != "kfusion":
        return {DEFAULT: dict(space.default)}
    return {
        DEFAULT if name == DEFAULT_OF_THE_APP else name.lower(): configuration.to_dict()
        for name, configuration in ANDROID_APP.items()
    }
