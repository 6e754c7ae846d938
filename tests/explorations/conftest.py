"""A tiny sequence, a small space and explorations over them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from crowd.celery import app
from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.measurement import Measurement, sequence_names, stop_after
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.content import plans
from slam import isolated
from slam.datasets import open_sequence
from slam.stopping import find_broken
from tests.server import *  # noqa: F403 - its fixtures
from tests.slam.tiny import write_tiny_pack

SPACE = {
    "name": "small",
    "parameters": [
        {"name": "compute_size_ratio", "type": "ordinal", "values": [1, 2, 4], "default": 2},
        {"name": "integration_rate", "type": "ordinal", "values": [1, 2, 5, 20], "default": 2},
        {"name": "tracking_rate", "type": "ordinal", "values": [1, 2, 9], "default": 1},
        {"name": "volume_resolution", "type": "ordinal", "values": [32, 64], "default": 64},
    ],
}


FACTORS = {"tiny": 1.0, "desk": 2.0, "attic": 4.0, "library": 8.0}
MORE = ("desk", "attic", "library")


@pytest.fixture(scope="session")
def tiny_pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence that is measured in a moment."""
    return write_tiny_pack(tmp_path_factory.mktemp("sequences"))


@pytest.fixture(scope="session")
def more_packs(tiny_pack: Path) -> dict[str, dict[str, str]]:
    """Name and digest of further sequences beside the tiny one."""
    digests = {name: open_sequence(write_tiny_pack(tiny_pack.parent, name=name)).sha256 for name in MORE}
    return {name: {"name": name, "sha256": digest} for name, digest in digests.items()}


@pytest.fixture
def unsaved(db: None, tiny_pack: Path, settings: Any) -> Exploration:
    """An exploration that could be created, over the small space and the tiny sequence."""
    settings.FRONTRUNNER_SEQUENCES = [tiny_pack.parent]
    device = ReferenceDevice.objects.create(name="bench", queue="bench")
    return Exploration(
        space=SPACE,
        sequence="tiny",
        sequence_sha256=open_sequence(tiny_pack).sha256,
        reference_device=device,
        objectives=["ate_max", "runtime"],
        limits={"ate_max": 0.05},
        method="random",
        budget=6,
        batch=4,
        points=3,
        repeats=2,
    )


@pytest.fixture
def exploration(unsaved: Exploration) -> Exploration:
    """A created one: its known configurations wait."""
    return services.create(unsaved)


@pytest.fixture
def several(unsaved: Exploration, more_packs: dict[str, dict[str, str]]) -> Exploration:
    """One that could be created, which learns on tiny, desk and attic; library is held out."""
    unsaved.further_sequences = [more_packs["desk"], more_packs["attic"]]
    unsaved.held_out_sequences = [more_packs["library"]]
    return unsaved


@pytest.fixture
def committing(django_capture_on_commit_callbacks: Any) -> Any:
    """A with statement at whose end the transaction counts as stored: what waits for that is done."""
    return lambda: django_capture_on_commit_callbacks(execute=True)


@pytest.fixture
def unread_queues() -> Iterator[None]:
    """Tasks are sent to queues without a worker; those of earlier tests are gone."""
    with app.connection_for_write() as broker:
        for name in ("bench", "crowd"):
            broker.SimpleQueue(name).clear()
    app.conf.update(task_always_eager=False)
    yield
    app.conf.update(task_always_eager=True)


def measurement(configuration: dict[str, Any]) -> Measurement:
    """What some machine might measure; the error grows as the time shrinks."""
    ratio, rate = configuration["compute_size_ratio"], configuration["tracking_rate"]
    runtime = (0.1 / ratio**2 + 0.02 / configuration["integration_rate"]) * (1 + 0.1 / rate)
    error = 0.002 * ratio * rate * (1 + 0.01 * configuration["integration_rate"])
    objectives = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2, "ate_rmse": error / 2}
    stages = {"preprocessing": runtime / 2, "tracking": runtime / 2, "integration": 0.0, "raycasting": 0.0}
    device = {"platform": "p", "name": "Bench CPU", "driver": "1.0", "backend": "opencl"}
    return Measurement(objectives, stages, device)


def reference(evaluation: Evaluation) -> dict[str, Any]:
    """What some machine's devices might say of the evaluation's configuration: they hardly differ."""
    exploration = evaluation.exploration
    return {
        "trajectory": [[0.01 * frame, 0.5, 0.1] for frame in range(evaluation.frames or 0)],
        "band": 0.002,
        "largest_deviation": 0.0003,
        "variants": ["Bench CPU 1.0, rows", "Bench CPU 1.0, pixels"],
        "program": plans.program_digest(
            exploration.application, exploration.sequence_sha256, evaluation.configuration
        ),
    }


def measured_on(evaluation: Evaluation) -> Measurement:
    """What some machine might measure on the evaluation's sequences, errors FACTORS times as large."""
    above = 0
    found = measurement(evaluation.configuration)
    if evaluation.phase == Evaluation.Phase.REFERENCE:
        return replace(found, reference=reference(evaluation))
    parts: list[dict[str, Any]] = []
    for pack in sequence_names(evaluation):
        factor = FACTORS[pack["name"]]
        values = {
            name: factor * value if name.startswith("ate_") else value
            for name, value in found.objectives.items()
        }
        parts.append({"sequence": pack["name"], "lost": 0, "stopped_at": None, **values})
        above += find_broken(evaluation.stop_above, values) is not None
        if above == stop_after(evaluation):
            break
    return Measurement(isolated.combine(parts), found.stages, found.device, tuple(parts))


def finish(evaluations: list[Evaluation]) -> None:
    """Record a measurement for each."""
    for waiting in evaluations:
        with leases.leased(waiting.pk) as evaluation:
            assert evaluation is not None
            assert leases.record(evaluation, measured_on(evaluation))


def run_to_the_end(exploration: Exploration) -> Exploration:
    """Measure whatever is asked for until nothing is."""
    while waiting := services.pending_evaluations(exploration) or services.advance(exploration.pk):
        finish(waiting)
    exploration.refresh_from_db()
    return exploration
