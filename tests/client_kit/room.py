"""A small sequence pack that every configuration below really runs over, in a fraction of a second."""

import json
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest
from client_kit.delivery.reference_trajectories import Positions
from client_kit.measuring import measurement
from client_kit.measuring.measurement import Observer, Task
from client_kit.measuring.session import Run, Session
from slam.datasets.formats import pack
from slam.devices.choice import choose_device
from tests.builders import manifests
from tests.client_kit.observing import Calling
from tests.slam.kfusion.test_pipeline import CAMERA, SCENE, depth_from, handheld
from tests.slam.sequences import ArraySequence

FRAMES = 12
BAND = 0.02

CONFIGURATIONS = {
    "default": {"volume_resolution": 128, "integration_rate": 1},
    "best": {"volume_resolution": 64, "compute_size_ratio": 2},
    "indivisible": {"compute_size_ratio": 7},
}


def write(folder: Path, name: str = "room") -> pack.Pack:
    """Write the room as a pack of two chunks of frames and a header."""
    truth = handheld(FRAMES)
    sequence = ArraySequence(
        [depth_from(pose) for pose in truth],
        truth=truth,
        name=name,
        volume_size=SCENE.volume_size,
        initial_position=SCENE.initial_position,
    )
    sequence.camera = CAMERA
    return pack.write(sequence, folder)


def positions(shift: float = 0.0) -> list[list[float]]:
    """Where the room's camera really is after each frame, `shift` metres aside, in the volume's frame."""
    start = np.array(SCENE.initial_position) * SCENE.volume_size
    found: list[list[float]] = (start + handheld(FRAMES)[:, :3, 3] + [shift, 0.0, 0.0]).tolist()
    return found


NEAR, FAR = (json.dumps(positions(shift)).encode() for shift in (0.0, 0.1))
TRAJECTORIES = {manifests.digest(data): data for data in (NEAR, FAR)}


def manifest(room: pack.Pack, far: tuple[str, ...] = (), **changes: Any) -> dict[str, Any]:
    """A manifest that asks for default and best over the room; the references of `far` are 10 cm aside."""
    sequence = room.manifest | {"colour": None}
    for chunk in sequence["chunks"]:
        chunk["url"] = f"/sequences/{chunk['sha256']}"
    configurations = [
        manifests.configuration(
            name,
            dict(parameters),
            band=BAND,
            trajectory=manifests.reference(FAR if name in far else NEAR),
        )
        for name, parameters in CONFIGURATIONS.items()
    ]
    return manifests.manifest(sequence=sequence, configurations=configurations, **changes)


def references(asked: Manifest) -> dict[str, Positions]:
    """The reference trajectories of a manifest over the room."""
    return {
        configuration.name: json.loads(TRAJECTORIES[configuration.trajectory.sha256])
        for configuration in asked.configurations
    }


def task(room: pack.Pack, asked: Manifest, plan: tuple[str, ...]) -> Task:
    """To measure `plan` over the room."""
    return Task(asked, plan, room._chunks.folder, references(asked))


class Watched:
    """A session over the room that is really measured, and all that it calls meanwhile."""

    PLAN = ("default", "best", "indivisible", "best", "default")

    def __init__(self, room: pack.Pack) -> None:
        self.asked = Manifest.parse(manifest(room))
        self.runs: list[Run] = []
        self.frames: list[tuple[str, int, int, float | None]] = []
        observer = Calling(on_run=self.runs.append, on_frame=lambda *frame: self.frames.append(frame))
        self.session, _ = measurement.measure(task(room, self.asked, self.PLAN), choose_device(), observer)

    def again(self, asked: Manifest, plan: tuple[str, ...] = ()) -> Session:
        """What was measured, as another session for `asked`, of the runs in `plan` or of its own plan."""
        plan = plan or asked.plan()
        runs: list[Run] = []
        for order, name in enumerate(plan):
            measured = [run for run in self.runs if run.configuration == name]
            repeat = plan[:order].count(name)
            like = measured[repeat % len(measured)]
            runs.append(replace(like, id=uuid.uuid4(), repeat=repeat, order=order))
        return replace(self.session, id=uuid.uuid4(), front_version=asked.front_version, runs=tuple(runs))

    @contextmanager
    def replayed(self) -> Iterator[None]:
        """Every measurement gives this session again, except what is known not to run on its device."""

        def measure(task: Task, _: Any, observer: Observer, *__: Any) -> tuple[Session, bool]:
            session = self.again(task.asked, task.plan)
            runs = list(session.runs)
            for place, run in enumerate(runs):
                if reason := task.impossible.get(run.configuration):
                    runs[place] = Run(
                        run.id, run.configuration, run.repeat, run.order, "failed", [], failure=reason
                    )
                observer.run(runs[place])
            session = replace(session, runs=tuple(runs))
            observer.session(session)
            return session, False

        with mock.patch.object(measurement, "measure", measure):
            yield
