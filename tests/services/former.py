"""What the first version of this software left in a database, written with its own models: all at 0001."""

import hashlib
import json
import uuid
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from django.core.management import call_command
from django.db import connection
from django.db.migrations.executor import MigrationExecutor

from crowd.fronts.publishing import guards
from tests.crowd.documents import FRAMES, STAGES, device_document, write_pack
from tests.crowd.earlier_fronts import document_of_protocol_1

FIRST = [("results", "0001_initial"), ("explorations", "0001_initial")]
SPACE = {"name": "tiny", "parameters": [{"name": "a", "type": "ordinal", "values": [1, 2], "default": 1}]}
TOKEN = "a-token-of-the-first-version"
SESSIONS = 3
DEFAULT_US, BEST_US = 80_000, 10_000
MEASURED = datetime(2026, 11, 20, 10, 17, tzinfo=UTC)


def packed(microseconds: int) -> bytes:
    """A series of equal times, as runs have always been stored."""
    return np.full(FRAMES, microseconds, "<u4").tobytes()


def make(var: str) -> None:
    """Make the tables of the first version in an empty database, and fill them; prints the runs' ids."""
    for application, migration in FIRST:
        call_command("migrate", application, migration, verbosity=0)
    # The first version had no triggers; the next `migrate` puts them back.
    guards.drop(connection.alias)
    apps = MigrationExecutor(connection).loader.project_state(FIRST).apps

    def create(label: str, **values: Any) -> Any:
        return apps.get_model(label).objects.create(**values)

    pack = write_pack(Path(var) / "sequences")
    document = document_of_protocol_1(pack, "test")
    front = create(
        "fronts.FrontVersion",
        slug="kfusion-test",
        application="kfusion",
        version="test",
        state="published",
        published_at=MEASURED,
        digest="0" * 64,
        protocol=document["protocol"],
        sequence=pack,
        provenance=document["provenance"],
    )
    points = {
        point["name"]: create("fronts.Configuration", front=front, position=position, **point)
        for position, point in enumerate(document["configurations"])
    }
    model = create(
        "devices.DeviceModel",
        key="google pixel 8",
        slug="google-pixel-8",
        manufacturer="Google",
        name="Pixel 8",
        os="Android",
    )
    raw = device_document()
    digest = hashlib.sha256(json.dumps(raw).encode()).hexdigest()
    description = create("devices.DeviceDescription", digest=digest, raw=raw, model=model)
    installation = create(
        "devices.Installation",
        token_sha256=hashlib.sha256(TOKEN.encode()).hexdigest(),
        app="client_kit",
        app_version="0.1.0",
        consent_version=1,
    )
    ids = []
    for number in range(SESSIONS):
        submission = create(
            "results.Submission",
            installation=installation,
            idempotency_key=f"key-{number}",
            body_sha256="0" * 64,
            answer=json.dumps({"items": []}),
            schema_version=1,
            app_version="0.1.0",
            consent_version=1,
        )
        session = create(
            "results.MeasurementSession",
            uuid=uuid.uuid4(),
            installation=installation,
            submission=submission,
            description=description,
            device=model,
            front=front,
            protocol_version=1,
            backend="opencl",
            processor=raw["opencl_device"],
            platform=raw["opencl_platform"],
            driver=raw["opencl_driver"],
            started_at=MEASURED,
            samples=[],
            summary_algorithm=1,
        )
        schedule = (("default", 0), ("best", 0), ("best", 1), ("default", 1))
        for order, (name, repeat) in enumerate(schedule):
            level = DEFAULT_US if name == "default" else BEST_US
            run = create(
                "results.Run",
                uuid=uuid.uuid4(),
                session=session,
                configuration=points[name],
                repeat=repeat,
                order=order,
                status="ok",
                frame_us=packed(level),
                stages=list(STAGES),
                stages_us=b"".join(packed(int(level * share)) for share in STAGES.values()),
                tracked=bytes([2] * 4 + [1] * (FRAMES - 4)),
                tracked_frames=FRAMES - 4,
                mean_us=float(level),
                ate_max=0.012,
                trajectory_sha256="0" * 64,
                state="valid",
            )
            ids.append(str(run.uuid))
        create(
            "results.SessionSummary",
            session=session,
            configuration=points["best"],
            baseline=points["default"],
            algorithm=1,
            log_ratio=float(np.log(DEFAULT_US / BEST_US)),
            pairs=2,
            drift=1.0,
            ate_max=0.012,
            state="valid",
        )
    create(
        "results.DeviceSpeedup",
        device=model,
        front=front,
        configuration=points["best"],
        baseline=points["default"],
        backend="opencl",
        processor=raw["opencl_device"],
        algorithm=1,
        speedup=DEFAULT_US / BEST_US,
        sessions=SESSIONS,
        installations=1,
        ate_max=0.012,
        state="valid",
        last_session_at=MEASURED,
    )
    create("results.WorkerPulse", task="sweep", at=MEASURED)
    bench = create("explorations.ReferenceDevice", name="bench", queue="bench")
    exploration = create(
        "explorations.Exploration",
        space=SPACE,
        sequence=pack["name"],
        sequence_sha256=pack["sha256"],
        reference_device=bench,
        objectives=["ate_max", "runtime"],
        method="random",
        budget=2,
        state="stopped",
    )
    create(
        "explorations.Evaluation",
        exploration=exploration,
        number=0,
        phase="random",
        configuration={"a": 1},
        configuration_key="0" * 64,
        state="done",
        objectives={"runtime": 0.1, "ate_max": 0.01},
    )
    print(json.dumps(ids))
