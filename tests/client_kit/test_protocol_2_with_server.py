"""Protocol 2 from end to end: a real server publishes references, the client compares, the server judges."""

import json
from typing import Any

import pytest

from client_kit.home import Home
from client_kit.spool import Spool
from crowd.results.models import MeasurementSession
from slam.datasets.pack import Pack
from slam.devices.choice import list_devices
from slam.devices.device import BACKENDS
from tests.client_kit import protocol_2, room
from tests.client_kit.published import publish
from tests.client_kit.test_with_server import client


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


def serve(live_server: Any, settings: Any, pack: Pack, far: tuple[str, ...] = ()) -> str:
    """The address of a server that asks for default and best by protocol 2."""
    document, files = protocol_2.manifest(pack, far, repeats=2)
    points = document["configurations"][:2]
    for point in points:
        point["trajectory"] = json.loads(files[point["trajectory"]["sha256"]])
    publish(settings, pack, document["protocol"], points)
    return str(live_server.url)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_session_of_protocol_2_is_taken_whole(
    backend: str, live_server: Any, settings: Any, pack: Pack, home: Home
) -> None:
    if not list_devices(backend):
        pytest.skip(f"no device over {backend} here")
    server = serve(live_server, settings, pack)

    done = client(home, "run", "--server", server, "--yes", "--backend", backend)

    assert done.returncode == 0, done.stderr
    [item] = Spool(home.spool).items()
    assert (item.state, item.reason) == ("accepted", None)
    [session] = MeasurementSession.objects.all()
    assert (session.protocol_version, session.backend, session.extra) == (2, backend, {})
    assert session.empty_frame_us > 0
    assert session.stage_clock == ("device" if backend == "opencl" else "none")
    runs = list(session.runs.all())
    judged = [(run.state, run.reason, run.failure, run.extra) for run in runs]
    assert judged == [("valid", "", "", {})] * 4
    assert all(0 < run.deviation < protocol_2.BAND for run in runs)


def test_a_run_outside_its_band_is_judged_by_the_server_as_by_the_client(
    live_server: Any, settings: Any, pack: Pack, home: Home
) -> None:
    server = serve(live_server, settings, pack, far=("best",))

    done = client(home, "run", "--server", server, "--yes", "--backend", "opencl")

    assert done.returncode == 0, done.stderr
    assert done.stdout.count("so the run does not count.") == 2
    [session] = MeasurementSession.objects.all()
    runs = session.runs.select_related("configuration")
    assert {(run.configuration.name, run.state, run.reason) for run in runs} == {
        ("default", "valid", ""),
        ("best", "invalid", "deviation_above_band"),
    }
