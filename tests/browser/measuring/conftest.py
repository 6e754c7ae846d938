"""A server with a small published front, and someone who has never been there."""

import math
import shutil
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from crowd.fronts import manifests
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from slam.datasets.formats.pack import Pack
from slam.isolated import measure_reference
from tests.browser.visitor import Visitor
from tests.builders.documents import STANDARD
from tests.client_kit.web.serving import WEB, measurement_at_any_speed
from tests.slam.tiny import write_tiny_pack
from tests.waiting import PATIENCE_SECONDS, until

FRAMES = 8
# The software adapter pays for every launch and pixel.
DEFAULT = STANDARD | {
    "compute_size_ratio": 2, "volume_resolution": 64, "integration_rate": 1, "tracking_rate": 1,
    "pyramid_iterations_fine": 6, "pyramid_iterations_middle": 2, "pyramid_iterations_coarse": 0,
}  # fmt: skip
BEST = DEFAULT | {"pyramid_iterations_fine": 2, "pyramid_iterations_middle": 1, "tracking_rate": 2}
PROBES = {"probe-1": BEST | {"pyramid_iterations_fine": 3}, "probe-2": BEST | {"integration_rate": 2}}


@dataclass(frozen=True)
class Published:
    """The folder with the sequence, and the front's document: its references are measured, over OpenCL."""

    sequences: Path
    document: dict[str, Any]


@pytest.fixture(scope="package")
def published(tmp_path_factory: pytest.TempPathFactory) -> Published:
    folder = tmp_path_factory.mktemp("sequences")
    pack = Pack(write_tiny_pack(folder))
    slow, fast = (
        {
            "runtime": 0.04 * ratio, "ate_max": 0.01, "ate_mean": 0.005,
            "on_sequence": {"runtime_ratio": ratio, "low": ratio, "high": ratio, "rounds": 4, "stages": {}},
        }
        for ratio in (1.0, 0.25)
    )  # fmt: skip
    document: dict[str, Any] = {
        "application": "kfusion",
        "version": "web",
        "protocol": {
            "version": 2, "warmup_frames": 2, "frames": FRAMES, "first_counted_frame": 4,
            "order": ["default", "best", "best", "default"], "repeats": 4, "rest_seconds": 0, "max_ate": 0.05,
        },
        "sequence": {"name": pack.name, "sha256": pack.sha256},
        "configurations": [
            {"name": "default", "parameters": DEFAULT, "predicted": slow},
            {"name": "best", "parameters": BEST, "predicted": fast},
        ],
        "probes": [
            {"name": name, "parameters": parameters, "predicted": fast} for name, parameters in PROBES.items()
        ],
        "provenance": {"note": "made up for testing", "evaluations": 0},
    }  # fmt: skip
    for point in (*document["configurations"], *document["probes"]):
        measured = measure_reference("kfusion", point["parameters"], folder / "tiny", frames=FRAMES)
        assert measured.reference is not None
        point |= {name: measured.reference[name] for name in ("band", "trajectory")}
    return Published(folder, document)


@pytest.fixture
def front(transactional_db: None, settings: Any, published: Published) -> FrontVersion:
    """The front, published on this test's server."""
    settings.FRONTRUNNER_SEQUENCES = [published.sequences]
    settings.FRONTRUNNER_QUORUM = 3
    for cache in (plans._pack, plans._build, plans._plans_of_fronts, manifests._build):
        cache.cache_clear()
    return publish_content(published.document)[0]


@pytest.fixture
def visitor(chromium: Any, live_server: Any, front: FrontVersion) -> Iterator[Visitor]:
    """Someone with a phone who has never been here."""
    before = set(threading.enumerate())  # a test elsewhere may have left a connection open
    one = Visitor(chromium, live_server.url, width=390)
    one.page.set_default_timeout(PATIENCE_SECONDS * 1000)
    yield one
    one.context.close()

    # What a closed page had sent is answered now, and leaves nothing for the next test to count.
    def answered() -> bool:
        new = set(threading.enumerate()) - before
        return not any("process_request_thread" in thread.name for thread in new)

    until(answered, 30)


@pytest.fixture(autouse=True)
def any_speed(monkeypatch: pytest.MonkeyPatch, settings: Any, tmp_path: Path) -> None:
    """How fast and how evenly a busy machine computes decides nothing here."""
    settings.FRONTRUNNER_WEB_CLIENT = shutil.copytree(WEB, tmp_path / "web")
    (tmp_path / "web" / "measurement.js").write_text(measurement_at_any_speed(), encoding="utf-8")
    monkeypatch.setattr("frontrunner.session_statistics.LEAST_DEVIATION", math.inf)
    monkeypatch.setattr("crowd.predictions.probe_assignment.MAX_DRIFT", math.inf)
    monkeypatch.setattr(
        "crowd.results.validity.plausibility.plausible_range", lambda *_: (-math.inf, math.inf)
    )
