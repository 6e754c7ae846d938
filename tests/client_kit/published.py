"""A front that a real server publishes over the small room."""

import json
from collections.abc import Sequence
from typing import Any

from crowd.fronts.publishing import services
from slam.datasets.formats.pack import Pack
from tests.builders.documents import prepared
from tests.client_kit import room

VERSION = "test"


def publish(
    settings: Any,
    pack: Pack,
    protocol: dict[str, Any],
    configurations: list[dict[str, Any]],
    probes: Sequence[dict[str, Any]] = (),
) -> None:
    """Publish `configurations` and `probes` of a manifest over the room, as version VERSION, and serve
    `pack`."""

    def point(described: dict[str, Any]) -> dict[str, Any]:
        found = room.TRAJECTORIES.get(described["trajectory"]["sha256"], room.NEAR)
        return prepared(described | {"trajectory": json.loads(found)[: protocol["frames"]]})

    settings.FRONTRUNNER_SEQUENCES = [pack._chunks.folder.parent]
    services.publish_content(
        {
            "application": "kfusion",
            "version": VERSION,
            "protocol": protocol,
            "sequence": {"name": pack.name, "sha256": pack.sha256},
            # A server refuses a configuration that does not fit the sequence's camera.
            "configurations": [point(each) for each in configurations if each["name"] != "indivisible"],
            "probes": [point(each) for each in probes],
            "provenance": {"note": "made for a test"},
        }
    )
