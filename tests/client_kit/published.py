"""A front that a real server publishes over the small room."""

from collections.abc import Sequence
from typing import Any

from crowd.fronts.publishing import services
from slam.datasets.formats.pack import Pack

VERSION = "test"


def publish(
    settings: Any,
    pack: Pack,
    protocol: dict[str, Any],
    configurations: list[dict[str, Any]],
    probes: Sequence[dict[str, Any]] = (),
) -> None:
    """Publish CONFIGURATIONS and PROBES under PROTOCOL as version VERSION, and serve PACK."""
    settings.FRONTRUNNER_SEQUENCES = [pack._chunks.folder.parent]
    services.publish_content(
        {
            "application": "kfusion",
            "version": VERSION,
            "protocol": protocol,
            "sequence": {"name": pack.name, "sha256": pack.sha256},
            # A server refuses a configuration that does not fit the sequence's camera.
            "configurations": [each for each in configurations if each["name"] != "indivisible"],
            "probes": list(probes),
            "provenance": {"note": "made for a test"},
        }
    )
