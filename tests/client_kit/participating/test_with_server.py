"""The client and the real server together: what is measured here is judged and counted there, once."""

import json
import signal
import uuid
from typing import Any

import pytest
from django.test import Client as Browser

from client_kit.client import Client
from client_kit.delivery import enrolment, sending
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import ProblemError, Server
from client_kit.delivery.spool import Item, Spool
from client_kit.device import description
from client_kit.errors import UsageError
from client_kit.home import Home
from client_kit.measuring import session as record
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run
from slam.datasets.formats.pack import Pack
from slam.devices.choice import list_devices
from slam.devices.device import BACKENDS
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.commands import Terminal, start
from tests.client_kit.conftest import pack
from tests.client_kit.published import VERSION, publish
from tests.client_kit.scripted import Reply, Request, Serve
from tests.services.test_clients_survive import passing_on

__all__ = ["pack"]  # for tests elsewhere that use `server`


@pytest.fixture(scope="module")
def measured(pack: Pack, watched: room.Watched) -> dict[str, Any]:
    """What a session of default and best over the room sends."""
    asked = Manifest.parse(room.manifest(pack, front_version=f"kfusion-{VERSION}"))
    return record.payload(watched.again(asked), asked, description.identify())


def published(live_server: Any, settings: Any, pack: Pack, far: tuple[str, ...] = (), **protocol: Any) -> str:
    """The address of a server that has published the front of `room.manifest`."""
    manifest = room.manifest(pack, far)
    publish(settings, pack, manifest["protocol"] | protocol, manifest["configurations"])
    return str(live_server.url)


@pytest.fixture
def server(live_server: Any, settings: Any, pack: Pack) -> str:
    return published(live_server, settings, pack)


@pytest.fixture
def sent(server: str, home: Home, spool: Spool, measured: dict[str, Any]) -> Item:
    """A measured session that the server has."""
    item = spool.put(server, renamed(measured))
    sending.deliver(spool, home)
    return item


def renamed(payload: dict[str, Any]) -> dict[str, Any]:
    """The same measurement under new ids."""
    copy: dict[str, Any] = json.loads(json.dumps(payload))
    for session in copy["sessions"]:
        for one in (session, *session["runs"]):
            one["id"] = str(uuid.uuid4())
    return copy


@pytest.mark.parametrize(
    "backend", [pytest.param(name, marks=[] if name == "opencl" else pytest.mark.slow) for name in BACKENDS]
)
def test_a_session_is_taken_whole_and_becomes_a_speedup_with_a_page(
    backend: str, server: str, terminal: Terminal, spool: Spool
) -> None:
    if not list_devices(backend):
        pytest.skip(f"no device over {backend} here")

    code, out, error = terminal("run", "--server", server, "--yes", "--backend", backend)

    assert code == 0, error
    [item] = spool.items()
    assert (item.state, item.reason) == ("accepted", None)
    [session] = MeasurementSession.objects.all()
    assert (str(session.uuid), session.protocol_version, session.backend) == (item.id, 2, backend)
    assert session.empty_frame_us > 0
    assert session.stage_clock == {"opencl": "device", "webgpu": "none", "wasm": "wall"}[backend]
    runs = list(session.runs.all())
    assert [(run.state, run.reason, run.failure, run.extra) for run in runs] == [("valid", "", "", {})] * 4
    assert all(0 < run.deviation < room.BAND for run in runs)
    assert session.extra == {}
    [speedup] = DeviceSpeedup.objects.filter(configuration__name="best")
    line = next(line for line in out.splitlines() if line.startswith("Speedup of best"))
    printed = line.split(": ")[1].split(",")[0].split(" ")[0]
    assert float(printed) == pytest.approx(speedup.speedup, abs=0.006)
    assert f"{server}/devices/{session.device.slug}/" in out


@pytest.mark.slow
def test_a_run_outside_its_band_is_judged_by_the_server_as_by_the_client(
    live_server: Any, settings: Any, pack: Pack, terminal: Terminal
) -> None:
    server = published(live_server, settings, pack, far=("best",))

    code, out, error = terminal("run", "--server", server, "--yes", "--backend", "opencl")

    assert code == 0, error
    assert '"deviation": ' in out  # in the consent text
    assert "over OpenCL" in out
    # More where other programs disturb this machine: those runs are measured again.
    lines = [line for line in out.splitlines() if "computes a different result" in line]
    assert len(lines) >= 2
    for line in lines:
        assert line.endswith("cm from the reference, 2.00 cm allowed), so the run does not count.")
    assert "No speedup for best" in out
    [session] = MeasurementSession.objects.all()
    runs = session.runs.select_related("configuration")
    assert {(run.configuration.name, run.state, run.reason) for run in runs} == {
        ("default", "valid", ""),
        ("best", "invalid", "deviation_above_band"),
    }
    assert {run.configuration.name for run in runs if run.deviation > room.BAND} == {"best"}


@pytest.mark.slow
def test_a_session_of_probes_is_taken_whole(
    live_server: Any, client: Browser, settings: Any, pack: Pack, terminal: Terminal
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

    code, out, error = terminal.run(assigning, "--probes")

    assert code == 0, error
    assert "Thank you: predictions now include probe-1 on this device." in out
    assert terminal.states() == ["accepted"] * 2
    _, session = MeasurementSession.objects.order_by("id")
    runs = session.runs.order_by("order").select_related("configuration")
    assert [run.configuration.name for run in runs] == ["default", "probe-1", "probe-1", "default"]
    assert {(run.state, run.reason, run.failure) for run in runs} == {("valid", "", "")}


@pytest.mark.slow
def test_the_same_session_sent_again_changes_nothing(home: Home, spool: Spool, sent: Item) -> None:
    spool.postpone(sent, "as if the answer had been lost")
    sending.deliver(spool, home)

    assert spool.item(sent.id).state == "accepted"
    assert (MeasurementSession.objects.count(), Run.objects.count()) == (1, 4)


@pytest.mark.slow
def test_a_session_that_the_server_rejects_tells_why_and_the_next_one_counts(
    server: str, home: Home, spool: Spool, measured: dict[str, Any], terminal: Terminal
) -> None:
    bad = renamed(measured)
    for run in bad["sessions"][0]["runs"]:
        run["frame_us"].pop()
    items = [spool.put(server, payload) for payload in (bad, renamed(measured))]

    sending.deliver(spool, home)

    rejected, accepted = (spool.item(item.id) for item in items)
    assert (rejected.state, accepted.state) == ("rejected", "accepted")
    assert "frame_count" in (rejected.reason or "")
    assert MeasurementSession.objects.count() == 1
    assert "frame_count" in terminal("status")[1]


@pytest.mark.slow
def test_a_session_of_an_earlier_protocol_is_kept_reported_and_not_sent_again(
    server: str, home: Home, spool: Spool, measured: dict[str, Any], terminal: Terminal
) -> None:
    earlier = renamed(measured)
    [session] = earlier["sessions"]
    session["protocol_version"] = 1
    del session["empty_frame_us"], session["stage_clock"]
    item = spool.put(server, earlier)

    first, again = sending.deliver(spool, home), sending.deliver(spool, home)

    assert [(one.state, one.attempts) for one in first.settled] == [("rejected", 1)]
    assert again.settled == []
    assert spool.payload(spool.item(item.id)) == earlier
    assert "this server takes sessions of protocol 2" in terminal("status")[1]
    assert not MeasurementSession.objects.exists()


@pytest.mark.slow
def test_answers_lost_on_the_way_lead_to_one_session_each(
    server: str, home: Home, spool: Spool, measured: dict[str, Any], serve: Serve
) -> None:
    cut = iter([True, False, True, True, False, False])

    def losing(request: Request) -> Reply:
        reply = passing_on(server, request)
        lost = request.path.endswith("/submissions") and next(cut)
        return Reply(reply.status, raw=reply.raw, cut=10) if lost else reply

    proxy = serve(losing)
    for _ in range(3):
        spool.put(proxy.url, renamed(measured))

    for _ in range(5):
        sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["accepted"] * 3
    assert (MeasurementSession.objects.count(), Run.objects.count()) == (3, 12)


@pytest.mark.slow
def test_killed_in_its_second_session_a_client_loses_no_finished_run(
    live_server: Any, settings: Any, pack: Pack, home: Home, terminal: Terminal, spool: Spool
) -> None:
    server = published(live_server, settings, pack, repeats=8)

    with start(home, "run", "--server", server, "--yes", "--sessions", "2") as process:
        assert process.stdout is not None
        third_runs = (line for line in process.stdout if line.startswith("  3. "))
        assert [next(third_runs) for _ in range(2)]
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    [draft] = spool.drafts()
    assert "draft" in terminal("status")[1]
    for _ in range(2):
        assert terminal("send")[0] == 0

    whole, part = MeasurementSession.objects.order_by("id")
    assert (whole.runs.count(), str(part.uuid)) == (16, draft.id)
    orders = [run.order for run in part.runs.order_by("order")]
    assert 3 <= len(orders) < 16
    assert orders == list(range(len(orders)))
    assert terminal.states() == ["accepted"] * 2


@pytest.mark.slow
def test_export_shows_and_erase_removes_what_the_server_keeps(
    server: str, home: Home, spool: Spool, sent: Item, terminal: Terminal
) -> None:
    [session] = MeasurementSession.objects.all()

    exported = json.loads(terminal("export")[1])
    erased = terminal("erase", "--yes")[0]

    assert str(session.uuid) in json.dumps(exported["servers"][server])
    assert (erased, MeasurementSession.objects.count()) == (0, 0)
    assert (spool.items(), enrolment.all_enrolments(home)) == ([], [])


@pytest.mark.slow
def test_one_run_can_be_erased_and_the_token_be_replaced(
    server: str, home: Home, spool: Spool, sent: Item
) -> None:
    kit, old = Client(home=home.path), str(enrolment.current_token(home, Server(server)))
    run = kept_runs(spool)[0]

    assert kit.erase_run(run) == [server]
    assert kit.renew_tokens() == [server]

    assert Run.objects.count() == 3
    assert run not in kept_runs(spool)
    assert spool.item(sent.id).state == "accepted"
    new = str(enrolment.current_token(home, Server(server)))
    assert len(Server(server).own_data(new)["sessions"][0]["runs"]) == 3
    with pytest.raises(ProblemError, match="token_invalid"):
        Server(server).own_data(old)
    with pytest.raises(UsageError, match="have this run"):
        kit.erase_run(run)


def kept_runs(spool: Spool) -> list[str]:
    """The ids of all runs that the spool holds."""
    payloads = [spool.payload(item) or {} for item in spool.items()]
    return [run["id"] for payload in payloads for session in payload["sessions"] for run in session["runs"]]


def test_an_unknown_front_is_the_servers_reason(server: str, home: Home, spool: Spool) -> None:
    payload = manifests.payload(
        started_at="2026-01-01T00:00:00Z", protocol_version=2, backend="opencl", front_version="kfusion-none"
    )
    item = spool.put(server, payload | {"app_version": "0.1.0", "consent_version": 2})

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "rejected"
    assert "unknown_front_version" in (spool.item(item.id).reason or "")
