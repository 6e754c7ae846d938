"""A server with a small published front, and someone who has never been there."""

import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from crowd.fronts import manifests, sequences
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from slam.datasets import open_sequence
from slam.datasets.formats.pack import Pack
from slam.devices.choice import choose_device, open_session
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import KFusion
from slam.system import scene_of
from tests.browser.measuring.steps import widest_interval
from tests.browser.visitor import Visitor, all_answered
from tests.builders.documents import STANDARD
from tests.client_kit.web.serving import WEB, measurement_at_any_speed
from tests.slam.tiny import write_tiny_pack

FRAMES = 8
BAND = 0.002  # m: no device of this machine differs by a third of it
# The software adapter pays for every launch and pixel.
DEFAULT = STANDARD | {
    "compute_size_ratio": 2, "volume_resolution": 64, "integration_rate": 1, "tracking_rate": 1,
    "pyramid_iterations_fine": 6, "pyramid_iterations_middle": 2, "pyramid_iterations_coarse": 0,
}  # fmt: skip
BEST = DEFAULT | {"pyramid_iterations_fine": 2, "pyramid_iterations_middle": 1, "tracking_rate": 2}
PROBES = {"probe-1": BEST | {"pyramid_iterations_fine": 3}, "probe-2": BEST | {"integration_rate": 2}}


@dataclass(frozen=True)
class Published:
    """The folder with the sequence, and the front's document: references by WebAssembly."""

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
    sequence = open_sequence(folder / "tiny")
    session = open_session(choose_device(backend="wasm"))
    for point in (*document["configurations"], *document["probes"]):
        system = KFusion(Configuration(**point["parameters"]), scene_of(sequence), session)
        poses = [system.process(sequence.depth(number)).pose for number in range(FRAMES)]
        point |= {"band": BAND, "trajectory": [pose[:3, 3].tolist() for pose in poses]}
    return Published(folder, document)


@pytest.fixture
def front(transactional_db: None, settings: Any, published: Published) -> FrontVersion:
    """The front, published on this test's server."""
    settings.FRONTRUNNER_SEQUENCES = [published.sequences]
    settings.FRONTRUNNER_QUORUM = 3
    for cache in (sequences.open_pack, plans._build, plans._plans_of_fronts, manifests._build):
        cache.cache_clear()
    return publish_content(published.document)[0]


@pytest.fixture
def visitor(webgpu_visitor: Visitor) -> Visitor:
    """The same without WebGPU: WebAssembly needs a third of the time of the software adapter."""
    webgpu_visitor.context.add_init_script("delete Navigator.prototype.gpu")
    return webgpu_visitor


@pytest.fixture
def webgpu_visitor(chromium: Any, live_server: Any, front: FrontVersion) -> Iterator[Visitor]:
    """Someone with a phone who has never been here."""
    with all_answered():  # and leaves nothing for the next test to count
        one = Visitor(chromium, live_server.url, width=390)
        yield one
        one.context.close()


@pytest.fixture(autouse=True)
def any_speed(monkeypatch: pytest.MonkeyPatch, settings: Any, tmp_path: Path) -> None:
    """How fast and how evenly a busy machine computes decides nothing here."""
    settings.FRONTRUNNER_WEB_CLIENT = shutil.copytree(WEB, tmp_path / "web")
    (tmp_path / "web" / "measurement.js").write_text(measurement_at_any_speed(), encoding="utf-8")
    widest_interval(tmp_path, "Infinity")
    monkeypatch.setattr("wire.session_statistics.WIDEST_INTERVAL", math.inf)
    monkeypatch.setattr("wire.session_statistics.LEAST_DEVIATION", math.inf)
    monkeypatch.setattr("crowd.predictions.probe_assignment.MAX_DRIFT", math.inf)
    monkeypatch.setattr(
        "crowd.results.validity.plausibility.plausible_range", lambda *_: (-math.inf, math.inf)
    )
