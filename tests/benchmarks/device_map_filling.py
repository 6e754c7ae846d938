"""A large simulated crowd: figures of every configuration, and a session, of each of many devices.

Part of `tests.benchmarks.device_map`. Ratios are the reference's to a power that differs by device, with
noise. The chips are made up; their names have the form of real ones.
"""

import uuid
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

COHORTS = 2_000
REPEATS = 4  # of default and best in a session
MAKERS = ("Adreno", "Mali-G", "Mali-T", "NVIDIA GeForce RTX", "AMD Radeon RX", "Intel UHD Graphics")
CHIPS = [f"{maker} {series}{member}" for maker in MAKERS for series in range(1, 9) for member in (10, 60)]
TIMES = {"default": 80_000.0, "best": 8_000.0}  # microseconds a frame
STAGE_SHARE, NOISE = 0.24, 0.2  # of a frame's time; of each frame's logarithm


def fill(slug: str, seed: int = 0) -> str:
    """Add COHORTS devices to an empty database with the front `slug`; says what was added."""
    from django.db import transaction

    from crowd.devices.models import DeviceDescription
    from crowd.devices.recognition import recognise
    from crowd.fronts import selectors as fronts
    from crowd.fronts.models import FrontVersion
    from crowd.predictions import tables
    from crowd.results.models import DeviceSpeedup, Run, RunFrames
    from tests.builders.documents import device_document

    random = np.random.default_rng(seed)
    row, front = FrontVersion.objects.get(slug=slug), fronts.front(slug)
    assert front is not None
    keys = {each.name: each.pk for each in row.configurations.all()}
    reference = tables.reference_ratios(front)
    ratios = {name: float(reference[name]) for name in reference.index if name in keys}
    with transaction.atomic():
        for number in range(COHORTS):
            recognise(device_document(f"Pixel {number:04d}"))
        described = list(DeviceDescription.objects.order_by("pk").values_list("model", "pk"))
        chips = [CHIPS[place % len(CHIPS)] for place in range(len(described))]
        group = {"front": row, "backend": "opencl", "processor_class": "gpu"}
        sessions = list(_sessions(described, chips, group, keys))
        for (device, _), chip in zip(described, chips, strict=True):
            DeviceSpeedup.objects.bulk_create(_figures(device, chip, group, keys, ratios, random))
        for session in sessions:
            runs = Run.objects.bulk_create(_runs(session, keys))
            RunFrames.objects.bulk_create(_frames(runs, front.content.protocol.frames, random))
    series = len({tables.chip_series(chip) for chip in chips})
    return (
        f"{len(described)} devices of {series} series, each with figures of {len(ratios)} configurations and "
        "a session"
    )


def _sessions(
    described: Sequence[tuple[int, int]],
    chips: Sequence[str],
    group: Mapping[str, Any],
    keys: Mapping[str, int],
) -> Iterator[int]:
    """A summarised session of each device and description; their keys."""
    from django.utils import timezone

    from crowd.devices.models import Installation
    from crowd.results.models import Cohort, MeasurementSession, SessionSummary, Submission
    from crowd.results.validity import version

    now, app = timezone.now(), {"app_version": "0.1.0", "consent_version": 1}
    who = Installation.objects.create(token_sha256="made-up", app="benchmark", **app)
    sent = Submission.objects.create(
        installation=who, idempotency_key="1", body_sha256="0" * 64, answer="{}", schema_version=1, **app
    )
    for (device, description), chip in zip(described, chips, strict=True):
        session = MeasurementSession.objects.create(
            uuid=uuid.uuid4(),
            installation=who,
            submission=sent,
            device_id=device,
            description_id=description,
            protocol_version=2,
            processor=chip,
            started_at=now,
            summary_algorithm=version.ALGORITHM,
            **group,
        )
        SessionSummary.objects.create(
            cohort=Cohort.objects.create(device_id=device, processor=chip, **group),
            installation=who,
            session=session,
            configuration_id=keys["best"],
            baseline_id=keys["default"],
            algorithm=version.ALGORITHM,
            log_ratio=float(np.log(TIMES["default"] / TIMES["best"])),
            pairs=REPEATS,
            state="valid",
            started_at=now,
            day=now.date(),
            counted=True,
        )
        yield session.pk


def _figures(
    device: int,
    chip: str,
    group: Mapping[str, Any],
    keys: Mapping[str, int],
    ratios: Mapping[str, float],
    random: np.random.Generator,
) -> Iterator[Any]:
    from django.utils import timezone

    from crowd.results.models import DeviceSpeedup
    from crowd.results.validity import version

    power = random.normal(1.0, 0.15)
    for name, log in ratios.items():
        yield DeviceSpeedup(
            device_id=device,
            processor=chip,
            configuration_id=keys[name],
            baseline_id=keys["default"],
            algorithm=version.ALGORITHM,
            speedup=float(np.exp(power * log + random.normal(0.0, 0.05))),
            deviation=float(random.uniform(0.02, 0.1)),
            units=3,
            sessions=3,
            installations=3,
            ate_max=0.02,
            state="valid",
            last_session_at=timezone.now(),
            **group,
        )


def _runs(session: int, keys: Mapping[str, int]) -> Iterator[Any]:
    from crowd.results.models import Run

    for repeat in range(REPEATS):
        for second, (name, mean_us) in enumerate(TIMES.items()):
            yield Run(
                uuid=uuid.uuid4(),
                session_id=session,
                configuration_id=keys[name],
                repeat=repeat,
                order=2 * repeat + second,
                status="ok",
                state="valid",
                mean_us=mean_us,
            )


def _frames(runs: Sequence[Any], frames: int, random: np.random.Generator) -> Iterator[Any]:
    """What each of `runs` measured in so many `frames`."""
    from crowd.results.intake import packing
    from crowd.results.models import RunFrames
    from slam.system import STAGES

    for run in runs:
        series = packing.Series(
            _series([run.mean_us], frames, random),
            list(STAGES),
            _series(np.full(len(STAGES), STAGE_SHARE * run.mean_us), frames, random),
            tracked=b"",
        )
        yield RunFrames(run=run, size=series.size, content=packing.compress(series))


def _series(means: ArrayLike, frames: int, random: np.random.Generator) -> bytes:
    """Times of `frames` frames around each of `means`, one after another, as they are stored."""
    times = np.asarray(means, dtype=float)[:, None] * random.lognormal(0.0, NOISE, (np.size(means), frames))
    return times.astype("<u4").tobytes()
