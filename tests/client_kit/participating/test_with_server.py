"""The client and the real server together: what is measured here is counted there, once."""

import json
import signal
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from client_kit.client import Client
from client_kit.delivery import enrolment, sending
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import ProblemError, Server
from client_kit.delivery.spool import Spool
from client_kit.device import description
from client_kit.errors import UsageError
from client_kit.home import Home
from client_kit.measuring import measurement
from client_kit.measuring import session as record
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run
from slam.datasets.formats.pack import Pack
from slam.devices.choice import choose_device
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.commands import client, start
from tests.client_kit.published import VERSION, publish
from tests.client_kit.scripted import Reply, Request, ScriptedServer

PROJECT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


@pytest.fixture(scope="module")
def measured(pack: Pack) -> dict[str, Any]:
    """What a session of default and best over the room sends."""
    asked = Manifest.parse(room.manifest(pack, front_version=f"kfusion-{VERSION}"))
    session = measurement.measure(
        pack._chunks.folder, asked, asked.plan(), choose_device(), references=room.references(asked)
    )
    return record.payload(session, asked, description.identify())


@pytest.fixture
def server(live_server: Any, settings: Any, pack: Pack) -> str:
    """The address of a server that has published a front over the room."""
    manifest = room.manifest(pack)
    publish(settings, pack, manifest["protocol"], manifest["configurations"])
    return str(live_server.url)


def test_a_measured_session_becomes_a_speedup_with_a_page(server: str, home: Home) -> None:
    done = client(home, "run", "--server", server, "--yes")

    assert done.returncode == 0, done.stderr
    [item] = Spool(home.spool).items()
    assert (item.state, item.reason) == ("accepted", None)
    [session] = MeasurementSession.objects.all()
    assert str(session.uuid) == item.id
    assert session.runs.count() == 4
    [speedup] = DeviceSpeedup.objects.filter(configuration__name="best")
    speedup_line = next(line for line in done.stdout.splitlines() if line.startswith("Speedup of best"))
    printed = speedup_line.split(": ")[1].split(",")[0].split(" ")[0]
    assert float(printed) == pytest.approx(speedup.speedup, abs=0.006)
    assert f"{server}/devices/{session.device.slug}/" in done.stdout


@pytest.mark.slow
def test_the_same_session_sent_again_changes_nothing(
    server: str, home: Home, spool: Spool, measured: dict[str, Any]
) -> None:
    item = spool.put(server, renamed(measured))
    sending.deliver(spool, home)

    spool.postpone(item, "as if the answer had been lost")
    sending.deliver(spool, home)

    assert spool.item(item.id).state == "accepted"
    assert (MeasurementSession.objects.count(), Run.objects.count()) == (1, 4)


@pytest.mark.slow
def test_a_session_that_the_server_rejects_tells_why_and_the_next_one_counts(
    server: str, home: Home, spool: Spool, measured: dict[str, Any]
) -> None:
    bad = renamed(measured)
    for run in bad["sessions"][0]["runs"]:
        run["frame_us"].pop()
    rejected, accepted = spool.put(server, bad), spool.put(server, renamed(measured))

    sending.deliver(spool, home)

    assert spool.item(accepted.id).state == "accepted"
    rejected = spool.item(rejected.id)
    assert rejected.state == "rejected"
    assert "frame_count" in (rejected.reason or "")
    assert MeasurementSession.objects.count() == 1
    assert "frame_count" in client(home, "status").stdout


@pytest.mark.slow
def test_a_session_of_an_earlier_protocol_is_kept_reported_and_not_sent_again(
    server: str, home: Home, spool: Spool, measured: dict[str, Any]
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
    assert "this server takes sessions of protocol 2" in client(home, "status").stdout
    assert not MeasurementSession.objects.exists()


@pytest.mark.slow
def test_answers_lost_on_the_way_lead_to_one_session_each(
    server: str, home: Home, spool: Spool, measured: dict[str, Any], serve: Callable[..., ScriptedServer]
) -> None:
    cut = iter([True, False, True, True, False, False])

    def through(request: Request) -> Reply:
        """Pass the request on, and lose some of the answers."""
        kept = {name: value for name, value in request.headers.items() if name not in ("host", "connection")}
        passed = urllib.request.Request(
            server + request.path, data=request.body or None, headers=kept, method=request.method
        )
        try:
            with urllib.request.urlopen(passed) as response:
                status, body = response.status, response.read()
        except urllib.error.HTTPError as error:
            status, body = error.code, error.read()
        lost = request.path.endswith("/submissions") and next(cut)
        return Reply(status, raw=body, cut=10 if lost else None)

    proxy = serve(through)
    for _ in range(3):
        spool.put(proxy.url, renamed(measured))

    for _ in range(5):
        sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["accepted"] * 3
    assert (MeasurementSession.objects.count(), Run.objects.count()) == (3, 12)


@pytest.mark.slow
def test_killed_in_its_second_session_a_client_loses_no_finished_run(
    live_server: Any, settings: Any, pack: Pack, home: Home
) -> None:
    manifest = room.manifest(pack)
    protocol = manifest["protocol"] | {"repeats": 20}
    publish(settings, pack, protocol, manifest["configurations"])
    server = str(live_server.url)

    with start(home, "run", "--server", server, "--yes", "--sessions", "2") as process:
        assert process.stdout is not None
        third_runs = (line for line in process.stdout if line.startswith("  3. "))
        assert [next(third_runs) for _ in range(2)]
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    [draft] = Spool(home.spool).drafts()
    assert "draft" in client(home, "status").stdout
    for _ in range(2):
        assert client(home, "send").returncode == 0

    whole, part = MeasurementSession.objects.order_by("id")
    assert (whole.runs.count(), str(part.uuid)) == (40, draft.id)
    orders = [run.order for run in part.runs.order_by("order")]
    assert 3 <= len(orders) < 40
    assert orders == list(range(len(orders)))
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"] * 2


@pytest.mark.slow
def test_export_shows_and_erase_removes_what_the_server_keeps(
    server: str, home: Home, spool: Spool, measured: dict[str, Any]
) -> None:
    spool.put(server, renamed(measured))
    sending.deliver(spool, home)
    [session] = MeasurementSession.objects.all()

    exported = json.loads(client(home, "export").stdout)
    erased = client(home, "erase", "--yes")

    assert str(session.uuid) in json.dumps(exported["servers"][server])
    assert erased.returncode == 0
    assert MeasurementSession.objects.count() == 0
    assert Spool(home.spool).items() == []
    assert enrolment.all_enrolments(home) == []


@pytest.mark.slow
def test_one_run_can_be_erased_and_the_token_be_replaced(
    server: str, home: Home, spool: Spool, measured: dict[str, Any]
) -> None:
    item = spool.put(server, renamed(measured))
    sending.deliver(spool, home)
    kit, old = Client(home=home.path), str(enrolment.current_token(home, Server(server)))
    run = measured_runs(spool)[0]

    assert kit.erase_run(run) == [server]
    assert kit.renew_tokens() == [server]

    assert Run.objects.count() == 3
    assert run not in measured_runs(spool)
    assert spool.item(item.id).state == "accepted"
    new = str(enrolment.current_token(home, Server(server)))
    assert len(Server(server).own_data(new)["sessions"][0]["runs"]) == 3
    with pytest.raises(ProblemError, match="token_invalid"):
        Server(server).own_data(old)
    with pytest.raises(UsageError, match="have this run"):
        kit.erase_run(run)


def measured_runs(spool: Spool) -> list[str]:
    """The ids of all runs that the spool holds."""
    payloads = [spool.payload(item) or {} for item in spool.items()]
    return [run["id"] for payload in payloads for session in payload["sessions"] for run in session["runs"]]


def test_an_unknown_front_is_the_servers_reason(server: str, home: Home, spool: Spool) -> None:
    payload = manifests.payload(
        started_at="2026-01-01T00:00:00Z", protocol_version=2, backend="opencl", front_version="kfusion-none"
    )
    payload |= {"app_version": "0.1.0", "consent_version": 2}
    item = spool.put(server, payload)

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "rejected"
    assert "unknown_front_version" in (spool.item(item.id).reason or "")


def renamed(payload: dict[str, Any]) -> dict[str, Any]:
    """The same measurement under new ids."""
    copy: dict[str, Any] = json.loads(json.dumps(payload))
    for session in copy["sessions"]:
        session["id"] = str(uuid.uuid4())
        for run in session["runs"]:
            run["id"] = str(uuid.uuid4())
    return copy
