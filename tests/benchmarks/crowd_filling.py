"""A database full of simulated measurements: python -m tests.benchmarks.crowd_filling RUNS DEVICES.

Adds RUNS runs, four a session, of the first published front to the deployment that the environment names.
The installations are called `simulated`, and no such phone exists. A few devices are very popular and most
are not, as in any crowd. Times have the form of KinectFusion's: noise over a level
that differs by device, installation and session, and dearer frames where the volume is updated.

Rows go in by COPY (PostgreSQL) or executemany (SQLite), with columns and defaults as the models have them.
"""

import itertools
import json
import sys
import time
import uuid
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from typing import Any

import django
import numpy as np

FRAMES = 100
STAGES = ("preprocessing", "tracking", "integration", "raycasting")
SHARES = np.array([0.1, 0.2, 0.2, 0.49])  # of each stage in the frame
REST = 0.01  # outside of all stages
TRACKED = bytes([2] * 4 + [1] * (FRAMES - 4))
SCHEDULE = (("default", 0), ("best", 0), ("best", 1), ("default", 1))
INSTALLATIONS_A_DEVICE = 10
CHUNK_SESSIONS = 2000
DAYS = 300
LEVELS = {"default": 80_000.0, "best": 10_000.0}  # microseconds a frame on the middle device
UPDATED_EVERY = {"default": 2, "best": 20}
POOL = 64


class Table:
    """Inserts rows of MODEL; all have the columns of `example` but those in `varying`, which each row
    brings."""

    def __init__(self, example: Any, varying: Sequence[str]) -> None:
        from django.db import connection

        self.connection, self.model = connection, type(example)
        fields = [
            field
            for field in self.model._meta.concrete_fields
            if not field.generated and (field.attname in varying or not field.primary_key)
        ]
        self.same = [
            (field.column, field.get_db_prep_save(field.pre_save(example, add=True), connection))
            for field in fields
            if field.attname not in varying
        ]
        by_name = {field.attname: field for field in fields}
        self.varying = [by_name[name] for name in varying]

    def insert(self, rows: Iterable[Sequence[Any]]) -> None:
        """Add `rows` of values of the varying columns, in their order."""
        columns = [field.column for field in self.varying] + [column for column, _ in self.same]
        fixed = [value for _, value in self.same]
        prepared = (
            [
                *(
                    f.get_db_prep_save(value, self.connection)
                    for f, value in zip(self.varying, row, strict=True)
                ),
                *fixed,
            ]
            for row in rows
        )
        names = ", ".join(map(self.connection.ops.quote_name, columns))
        table = self.connection.ops.quote_name(self.model._meta.db_table)
        with self.connection.cursor() as cursor:
            if self.connection.vendor == "postgresql":
                with cursor.copy(f"COPY {table} ({names}) FROM STDIN") as copy:
                    for row in prepared:
                        copy.write_row(row)
            else:
                marks = ", ".join(["%s"] * len(columns))
                cursor.executemany(f"INSERT INTO {table} ({names}) VALUES ({marks})", prepared)


class Series:
    """Compressed frames of one run after another, alike only where their levels are."""

    def __init__(self, random: np.random.Generator) -> None:
        noise = random.lognormal(0.0, 0.03, (POOL, FRAMES))
        self.shapes = {
            name: np.stack([np.where(np.arange(FRAMES) % every, 0.95, 1.2) * row for row in noise])
            for name, every in UPDATED_EVERY.items()
        }
        self.noise = random.lognormal(0.0, 0.03, (POOL, len(STAGES), FRAMES))
        self.turn = 0

    def next(self, configuration: str, level: float) -> tuple[Any, float]:
        """The series of a run, and its mean over the frames from 10 on. Each stage has noise of its own."""
        from crowd.results.intake import packing

        self.turn += 1
        shape = self.shapes[configuration][self.turn % POOL] * level
        stages = (SHARES[:, None] * shape * self.noise[self.turn % POOL]).astype("<u4")
        frames = stages.sum(axis=0) + (REST * shape).astype("<u4")
        packed = frames.astype("<u4").tobytes(), list(STAGES), stages.tobytes(), TRACKED
        return packing.Series(*packed), float(frames[10:].mean())


def fill(runs: int, devices: int, seed: int = 0) -> float:
    """Add `runs` runs of `devices` devices, which wait for their summaries; the seconds that it took."""
    from django.core.management.color import no_style
    from django.db import connection, transaction
    from django.utils import timezone

    from crowd.fronts.models import FrontVersion
    from crowd.results.intake import packing
    from crowd.results.models import MeasurementSession, Run, RunFrames, Submission

    begun = time.perf_counter()
    front = FrontVersion.objects.filter(state="published").order_by("pk")[0]
    configurations = {each.name: each.pk for each in front.configurations.all()}
    crowd = _crowd(devices)
    first, first_run = (
        (model.objects.order_by("-pk").values_list("pk", flat=True).first() or 0) + 1
        for model in (MeasurementSession, Run)
    )
    random = np.random.default_rng((seed, first))
    popularity = 1.0 / (np.arange(len(crowd)) + 20.0)
    chosen = random.choice(len(crowd), size=-(-runs // len(SCHEDULE)), p=popularity / popularity.sum())
    series, now = Series(random), timezone.now()
    description, installations = crowd[0]
    example = MeasurementSession(
        uuid=uuid.uuid4(),
        installation_id=installations[0],
        submission_id=uuid.uuid4(),
        description=description,
        device_id=description.model_id,
        front=front,
        protocol_version=2,
        empty_frame_us=250.0,
        stage_clock="device",
        backend="opencl",
        processor=description.processor,
        processor_class=description.processor_class,
        driver=description.driver,
        started_at=now,
    )
    sessions = Table(
        example,
        ["id", "uuid", "installation_id", "submission_id", "description_id", "device_id", "started_at"],
    )
    submissions = Table(
        Submission(
            installation_id=installations[0],
            body_sha256="0" * 64,
            answer=json.dumps({"items": []}),
            schema_version=1,
            app_version="0.1.0",
            consent_version=1,
        ),
        ["id", "installation_id", "idempotency_key"],
    )
    measured = Table(
        Run(
            uuid=uuid.uuid4(),
            session_id=1,
            configuration_id=1,
            repeat=0,
            order=0,
            status="ok",
            tracked_frames=FRAMES - 4,
            ate_max=0.012,
            ate_mean=0.008,
            ate_rmse=0.009,
            deviation=0.0005,
            state="valid",
        ),
        ["id", "uuid", "session_id", "configuration_id", "repeat", "order", "mean_us"],
    )
    frames = Table(RunFrames(run_id=1), ["run_id", "size", "content"])

    def rows(start: int, devices_of: Sequence[int]) -> Iterator[tuple[list[Any], ...]]:
        keys = itertools.count(first_run + start * len(SCHEDULE))
        for number, device in enumerate(devices_of, first + start):
            description, installations = crowd[device]
            who = installations[int(random.integers(len(installations)))]
            submission, session = uuid.UUID(bytes=random.bytes(16)), uuid.UUID(bytes=random.bytes(16))
            level = np.exp(0.5 * np.sin(device)) * random.lognormal(0.0, 0.03)
            gain = np.exp(0.3 * np.cos(device) + 0.05 * np.sin(who.int % 1000))
            when = now - timedelta(seconds=float(random.uniform(0, DAYS * 86400)))
            four, their_frames = [], []
            for order, (name, repeat) in enumerate(SCHEDULE):
                each = LEVELS[name] * level * random.lognormal(0.0, 0.02) / (gain if name == "best" else 1.0)
                key, run = next(keys), uuid.UUID(bytes=random.bytes(16))
                measured_frames, mean_us = series.next(name, each)
                four.append((key, run, number, configurations[name], repeat, order, mean_us))
                their_frames.append((key, measured_frames.size, packing.compress(measured_frames)))
            yield (
                [submission, who, submission.hex],
                [number, session, who, submission, description.pk, description.model_id, when],
                four,
                their_frames,
            )

    if connection.vendor == "sqlite":
        with connection.cursor() as cursor:
            cursor.execute("PRAGMA synchronous=OFF")
    for start in range(0, len(chosen), CHUNK_SESSIONS):
        made = list(rows(start, chosen[start : start + CHUNK_SESSIONS].tolist()))
        with transaction.atomic():
            submissions.insert(each for each, *_ in made)
            sessions.insert(each for _, each, *_ in made)
            measured.insert(run for _, _, four, _ in made for run in four)
            frames.insert(run for *_, their_frames in made for run in their_frames)
    with connection.cursor() as cursor:
        for statement in connection.ops.sequence_reset_sql(no_style(), [MeasurementSession, Run]):
            cursor.execute(statement)
        cursor.execute("ANALYZE")
    return time.perf_counter() - begun


def _crowd(devices: int) -> list[tuple[Any, list[uuid.UUID]]]:
    """Each device's description with its installations; made where they are missing."""
    from django.db import transaction

    from crowd.devices.models import DeviceDescription, DeviceModel, Installation
    from crowd.devices.recognition import recognise
    from tests.builders.documents import device_document

    with transaction.atomic():
        for number in range(devices):
            recognise(device_document(f"Pixel {number:04d}"))
        DeviceModel.objects.update(rare=False, changed=False)
        app = "simulated"
        missing = devices * INSTALLATIONS_A_DEVICE - Installation.objects.filter(app=app).count()
        Installation.objects.bulk_create(
            Installation(
                token_sha256=f"simulated-{uuid.uuid4().hex}",
                app=app,
                app_version="0.1.0",
                consent_version=1,
                network=uuid.uuid4().hex,
            )
            for _ in range(missing)
        )
    who = list(Installation.objects.filter(app=app).order_by("pk").values_list("pk", flat=True))
    described = DeviceDescription.objects.order_by("model__name")
    return [(description, who[number::devices]) for number, description in enumerate(described)]


if __name__ == "__main__":
    django.setup()
    print(json.dumps({"seconds": round(fill(int(sys.argv[1]), int(sys.argv[2])), 2)}))
