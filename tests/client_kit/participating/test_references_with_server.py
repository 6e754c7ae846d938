"""From end to end: a real server publishes references, the client compares, the server judges."""

from collections.abc import Callable
from typing import Any

import pytest
from django.test import Client

from client_kit.delivery.spool import Spool
from client_kit.home import Home
from crowd.results.models import MeasurementSession
from slam.datasets.formats.pack import Pack
from slam.devices.choice import list_devices
from slam.devices.device import BACKENDS
from tests.client_kit import room
from tests.client_kit.participating.test_with_server import client as run_client
from tests.client_kit.published import publish
from tests.client_kit.scripted import Reply, Request, ScriptedServer
from tests.services.test_clients_survive import passing_on


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


def serve(live_server: Any, settings: Any, pack: Pack, far: tuple[str, ...] = ()) -> str:
    """The address of a server that asks for default and best."""
    document = room.manifest(pack, far)
    publish(settings, pack, document["protocol"], document["configurations"])
    return str(live_server.url)


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_session_is_taken_whole(
    backend: str, live_server: Any, settings: Any, pack: Pack, home: Home
) -> None:
    if not list_devices(backend):
        pytest.skip(f"no device over {backend} here")
    server = serve(live_server, settings, pack)

    done = run_client(home, "run", "--server", server, "--yes", "--backend", backend)

    assert done.returncode == 0, done.stderr
    [item] = Spool(home.spool).items()
    assert (item.state, item.reason) == ("accepted", None)
    [session] = MeasurementSession.objects.all()
    assert (session.protocol_version, session.backend, session.extra) == (2, backend, {})
    assert session.empty_frame_us > 0
    assert session.stage_clock == {"opencl": "device", "webgpu": "none", "wasm": "wall"}[backend]
    runs = list(session.runs.all())
    judged = [(run.state, run.reason, run.failure, run.extra) for run in runs]
    assert judged == [("valid", "", "", {})] * 4
    assert all(0 < run.deviation < room.BAND for run in runs)


@pytest.mark.slow
def test_a_session_of_probes_is_taken_whole(
    live_server: Any,
    client: Client,
    settings: Any,
    pack: Pack,
    home: Home,
    serve: Callable[..., ScriptedServer],
) -> None:
    document = room.manifest(pack)
    points = document["configurations"]
    probe = {**points[1], "name": "probe-1", "parameters": {"volume_resolution": 64, "integration_rate": 2}}
    publish(settings, pack, document["protocol"], points, [probe])
    asked = client.get("/api/v1/manifest").json()
    probes = client.get(f"/api/v1/fronts/{asked['front_version']}").json()["probes"]
    asked["configurations"] = [asked["configurations"][0], *probes]
    asked["protocol"] |= {"order": ["default", "probe-1"], "repeats": 2}
    asked["assigned"] = [{"name": "probe-1", "why": "no other device has measured it"}]

    def assigning(request: Request) -> Reply:
        """The real server's answers, except the manifest of this device."""
        return Reply(200, asked) if "minutes=" in request.path else passing_on(live_server.url, request)

    done = run_client(home, "run", "--server", serve(assigning).url, "--yes", "--probes")

    assert done.returncode == 0, done.stderr
    assert "Thank you: predictions now include probe-1 on this device." in done.stdout
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"] * 2
    _, session = MeasurementSession.objects.order_by("id")
    runs = session.runs.order_by("order").select_related("configuration")
    assert [run.configuration.name for run in runs] == ["default", "probe-1", "probe-1", "default"]
    assert {(run.state, run.reason, run.failure) for run in runs} == {("valid", "", "")}


@pytest.mark.slow
def test_a_run_outside_its_band_is_judged_by_the_server_as_by_the_client(
    live_server: Any, settings: Any, pack: Pack, home: Home
) -> None:
    server = serve(live_server, settings, pack, far=("best",))

    done = run_client(home, "run", "--server", server, "--yes", "--backend", "opencl")

    assert done.returncode == 0, done.stderr
    # More where other programs disturb this machine: those runs are measured again.
    assert done.stdout.count("so the run does not count.") >= 2
    [session] = MeasurementSession.objects.all()
    runs = session.runs.select_related("configuration")
    assert {(run.configuration.name, run.state, run.reason) for run in runs} == {
        ("default", "valid", ""),
        ("best", "invalid", "deviation_above_band"),
    }
