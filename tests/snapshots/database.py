"""One small database with a row of each kind: null, suspect, masked, failed, erased and others.

It is the same whenever it is filled. All its figures are made up for testing.
"""

import hashlib
import json
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from django.test import Client

from crowd.celery import app
from crowd.devices.models import Installation
from crowd.explorations import services as explorations
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.fronts.publishing.services import publish_content
from crowd.predictions import maps
from crowd.results import moderation, tasks
from crowd.results.models import MeasurementSession
from crowd.results.opendata import exports
from slam.datasets.formats.pack import Pack
from tests.builders.documents import (
    FRAMES,
    beside_truth,
    browser_document,
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
    write_pack,
)
from tests.builders.explorations import SPACE, measured_on
from tests.builders.participant import Participant
from tests.crowd.figures.test_front_results import document as front_with_results
from tests.shipped import LIVING_ROOM
from tests.snapshots.fixed import World

Json = dict[str, Any]
PAIRS = 4  # enough for a session's own interval
NAMES = uuid.UUID("00000000-0000-4000-8000-000000000000")
PHONE = device_document()
BROWSER = browser_document()
RARE = device_document("P30", manufacturer="HUAWEI", soc_manufacturer=None, soc_model="Kirin 980")
COMPUTER = {
    "os": "Linux",
    "os_version": "6.1",
    "cpu": "AMD Ryzen 7 5800X 8-Core Processor",
    "opencl_platform": "Portable Computing Language",
    "opencl_device": "cpu-znver3-AMD Ryzen 7 5800X 8-Core Processor",
    "opencl_driver": "6.0",
}
WITHOUT_DRIVER = COMPUTER | {"opencl_platform": "wasmtime", "opencl_driver": "50.0.1"}
SLOW = device_document("Nexus 5", soc_model="MSM8974", opencl_device="Adreno (TM) 330")
LOST = device_document("moto g(30)", soc_model="SM6115", opencl_device="Adreno (TM) 610")
EMULATOR = device_document("sdk_gphone64_x86_64", soc_model="", opencl_device="SwiftShader")
UNKNOWN = {"os": None, "model": "", "opencl_device": "a chip of no known maker"}


@dataclass
class Site:
    """What is in the database: participants and their sessions by name, keys of explorations, tokens."""

    folder: Path
    participants: dict[str, Participant] = field(default_factory=dict)
    sessions: dict[str, Json] = field(default_factory=dict)
    finished: int = 0
    running: int = 0
    board: str = ""
    submission: str = ""


def fill(world: World, folder: Path) -> Site:
    """Fill the empty database, with the files below `folder`."""
    site = Site(folder)
    maps._reference_belief.cache_clear()
    _publish(world, json.loads((LIVING_ROOM / "pack.json").read_text()))
    _measure(world, site)
    _decide(world, site)
    _search(world, site)
    _erase(world, site)
    _send_without_worker(world, site)
    world.now = datetime(2026, 11, 23, 12, tzinfo=UTC)
    return site


def _publish(world: World, pack: Json) -> None:
    truth = Pack(LIVING_ROOM).truth
    assert truth is not None
    documents = {"early": front_document(pack, version="early"), "now": front_with_results(pack)}
    for step, document in documents.items():
        world.begin(f"front {step}")
        document["protocol"] |= {"repeats": PAIRS}
        for place, point in enumerate([*document["configurations"], *document.get("probes", ())]):
            point["trajectory"] = beside_truth(truth, 0.001 * place)
        publish_content(document)
        world.now = world.now.replace(minute=world.now.minute + 1)


def _measure(world: World, site: Site) -> None:
    """Sessions that count, and those that a rule excludes, each from a network of its own."""
    shown = {"show_model": True}
    for name, device, measured, members in (
        *((f"confirmed {at}", PHONE, _usual(us), {}) for at, us in enumerate((9_000, 10_000, 11_500))),
        *((f"browser {at}", BROWSER, partial(_of_browser, us), {}) for at, us in enumerate((20_000, 21_000))),
        ("webassembly", WITHOUT_DRIVER, _usual(30_000, backend="wasm", threads=4), shown),
        ("rare", RARE, _usual(12_000), {}),
        ("modern", COMPUTER, _modern, shown),
        ("failed", COMPUTER, _failed, shown),
        ("unbalanced", SLOW, _unbalanced, {}),
        ("contended", PHONE, _contended, {}),
        ("lost", LOST, _lost, {}),
        ("emulator", EMULATOR, _usual(9_500), {}),
        ("unknown", UNKNOWN, _usual(13_000, samples=[]), {}),
        ("moderated", PHONE, _usual(10_200), {}),
        ("run erased", PHONE, _usual(9_800), {}),
        ("erased", RARE, _usual(12_500), {}),
    ):
        _send(world, site, name, device, measured, **members)


def _send(
    world: World, site: Site, name: str, device: Json, measured: Callable[[], Json], **members: Any
) -> Any:
    """A session from a new installation `name`; the server's answer."""
    world.begin(name)
    token = f"token of {name}".replace(" ", "-")
    installation = Installation.objects.create(
        id=uuid.uuid5(NAMES, name),
        token_sha256=hashlib.sha256(token.encode()).hexdigest(),
        app="client_kit",
        app_version="0.1.0",
        consent_version=2,
        network=hashlib.sha256(name.encode()).hexdigest()[:32],
    )
    participant = Participant(Client(), token, str(installation.pk))
    hour = len(site.participants)
    session = measured() | {"started_at": f"2026-11-19T{hour:02}:17:00Z"}
    answer = participant.submit(
        submission_document(session, device=device, **members), key=name.replace(" ", "-")
    )
    assert answer.status_code == 202, answer.content
    assert {item["status"] for item in answer.json()["items"]} == {"accepted"}, answer.content
    site.participants[name], site.sessions[name] = participant, session
    return answer


def _usual(best_us: int, **changes: Any) -> Callable[[], Json]:
    """A session whose runs differ a little from each other."""

    def made() -> Json:
        session = session_document(best_us=best_us, pairs=PAIRS, **changes)
        for number, run in enumerate(session["runs"]):
            run["frame_us"] = [
                time + 13 * number + 7 * (frame % 9) for frame, time in enumerate(run["frame_us"])
            ]
        return session

    return made


def _of_browser(best_us: int) -> Json:
    """Without sensors, and without clocks for stages."""
    session = _usual(best_us, backend="webgpu", stage_clock="none", samples=[])()
    for run in session["runs"]:
        run |= {"stages_us": None, "ate_rmse": None, "tracked": FRAMES - 1}
    return session


def _modern() -> Json:
    """With what only new clients send."""
    session = _usual(11_000, blocks_repeated=1)()
    for number, run in enumerate(session["runs"]):
        run |= {"cpu_us": 4_000_000 + number, "waited_us": 1_000 + number}
    return session


def _failed() -> Json:
    session = _usual(10_500)()
    session["runs"][3] |= {
        "status": "failed", "failure": "out of memory", "frame_us": [], "stages_us": {}, "tracked": [],
        "ate_max": None, "ate_mean": None, "ate_rmse": None, "deviation": None,
    }  # fmt: skip
    return session


def _unbalanced() -> Json:
    """Default first and best last: suspect."""
    times = {"default": 80_000, "best": 10_000}
    runs = [
        run_document(name, number % PAIRS, number, times[name] + 1_000 * number)
        for number, name in enumerate(["default"] * PAIRS + ["best"] * PAIRS)
    ]
    return session_document(runs=runs)


def _contended() -> Json:
    """Other programs took the processor: suspect."""
    session = _usual(10_100)()
    for run in session["runs"]:
        run |= {"cpu_us": 1_000_000, "waited_us": 950_000}
    return session


def _lost() -> Json:
    """The best runs lost the camera: no figure."""
    session = _usual(8_000)()
    for run in session["runs"]:
        if run["configuration"] == "best":
            run |= {"ate_max": 0.4, "deviation": 0.2, "tracked": [True] * 40 + [False] * (FRAMES - 40)}
    return session


def _decide(world: World, site: Site) -> None:
    world.begin("decide")
    stored = MeasurementSession.objects.get(uuid=site.sessions["moderated"]["id"])
    moderation.decide("quarantine", "anna", "sent twice", stored)
    tasks.sweep()


def _search(world: World, site: Site) -> None:
    """A finished search with a failure and a held-out sequence; one whose evaluations wait for a board."""
    world.begin("search")
    packs = {name: write_pack(site.folder / "sequences", name) for name in ("tiny", "desk", "library")}
    device = ReferenceDevice.objects.create(name="bench", queue="bench")

    def named(name: str) -> dict[str, str]:
        return {"name": name, "sha256": packs[name]["sha256"]}

    search = Exploration(
        space=SPACE,
        sequence="tiny",
        sequence_sha256=packs["tiny"]["sha256"],
        further_sequences=[named("desk")],
        held_out_sequences=[named("library")],
        reference_device=device,
        objectives=["ate_max", "runtime"],
        limits={"ate_max": 0.05},
        method="random",
        budget=6,
        batch=4,
        points=3,
        repeats=2,
    )
    site.finished = _to_the_end(explorations.create(search))
    world.begin("second search")
    board = ReferenceDevice.objects.create(name="board", queue="board", machines=2)
    site.board = issue_token(board)
    later = explorations.clone(search, reference_device=board, method="algorithm1", budget=20)
    site.running = explorations.create(later).pk
    waiting = explorations.pending_evaluations(later)
    with leases.leased(waiting[0].pk, "worker 1") as evaluation:
        leases.record(evaluation, measured_on(evaluation))


def _to_the_end(search: Exploration) -> int:
    """Measure what the search asks for; the third measurement fails."""
    count = 0
    while waiting := explorations.pending_evaluations(search) or explorations.advance(search.pk):
        for pending in waiting:
            count += 1
            with leases.leased(pending.pk, "worker 1") as evaluation:
                if count == 3:
                    leases.fail(evaluation, "the process ended with signal 6")
                else:
                    leases.record(evaluation, measured_on(evaluation))
    return search.pk


def _erase(world: World, site: Site) -> None:
    """Between two exports: the files of the first are rewritten."""
    for day in (21, 22):
        world.begin(f"day {day}")
        world.now = datetime(2026, 11, day, 2, 30, tzinfo=UTC)
        exports.create_export()
        if day == 21:
            run = site.sessions["run erased"]["runs"][3]["id"]
            assert site.participants["run erased"].delete(f"/me/runs/{run}").status_code == 204
            assert site.participants.pop("erased").delete("/me").status_code == 204
            tasks.sweep()


def _send_without_worker(world: World, site: Site) -> None:
    """A session that is not judged yet."""
    world.now = datetime(2026, 11, 23, 11, tzinfo=UTC)
    app.conf.task_always_eager = False
    try:
        answer = _send(world, site, "pending", PHONE, _usual(9_900))
    finally:
        app.conf.task_always_eager = True
    site.submission = answer.json()["submission_id"]
