"""A front with probes that sixteen devices measured. It stays when another one ships."""

import json
from pathlib import Path
from typing import Any

from slam.datasets.formats.pack import Pack
from tests.builders.documents import beside_truth, prepared
from tests.shipped import LIVING_ROOM

FILE = Path(__file__).parents[2] / "docs" / "research" / "device-map-front.json"
NAME = "kfusion-4"


def known_front() -> dict[str, Any]:
    """The front as a document, with made-up trajectories and intervals."""
    document: dict[str, Any] = json.loads(FILE.read_text())
    truth = Pack(LIVING_ROOM).truth
    assert truth is not None
    for kind in ("configurations", "probes"):
        document[kind] = [
            prepared(point | {"trajectory": beside_truth(truth, 0.001 * place)})
            for place, point in enumerate(document[kind])
        ]
        for point in document[kind]:
            times = point["predicted"]["on_sequence"]
            times |= {"low": times["runtime_ratio"], "high": times["runtime_ratio"], "rounds": 1}
    return document
