"""Requests counted over several processes, and what waits, in Prometheus' text format."""

import os
import re
from collections.abc import Callable
from datetime import datetime, timedelta
from ipaddress import ip_network
from pathlib import Path
from typing import Any

import pytest
from django.db import OperationalError, connection
from django.test import Client
from django.utils import timezone
from rest_framework.settings import api_settings

from crowd.explorations.measuring.software import software_version
from crowd.observability import metrics
from crowd.operations.tasks import count_rows
from crowd.results.figures import sessions as session_figures
from crowd.results.models import MeasurementSession, RowCount
from crowd.results.validity import version
from tests.builders.documents import session_document, submission_document
from tests.builders.participant import Participant

DEPLOY = Path(__file__).parents[3] / "deploy"
ASKED = ("GET", "api/v1/speedups", "200")


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies are written at once, in the test's own thread."""

    class Now:
        daemon = False

        def __init__(self, _: float, save: Callable[[], None]) -> None:
            self.start = save

    monkeypatch.setattr(metrics.threading, "Timer", Now)


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is added of other processes, which run other tests."""
    monkeypatch.setattr(metrics, "registry", metrics.Registry())


@pytest.fixture
def moment(monkeypatch: pytest.MonkeyPatch) -> datetime:
    """The clock of the server stands still."""
    moment = timezone.now()
    monkeypatch.setattr(timezone, "now", lambda: moment)
    return moment


def reported(client: Client) -> dict[str, float]:
    """The value of each sample that the server reports, by its name and labels."""
    return samples(client.get("/metrics").content.decode())


def samples(text: str) -> dict[str, float]:
    """The value of each sample by its name and labels."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines)}


def test_a_process_adds_up_what_others_saw(tmp_path: Path, saved: None) -> None:
    here, there = metrics.Registry(), metrics.Registry()
    for process in (here, there):
        process.share(tmp_path, "web")

    here.observe("request_seconds", 0.003, *ASKED)
    there.observe("request_seconds", 0.2, *ASKED)
    there.observe("request_seconds", 70.0, *ASKED)

    assert here.rows() == there.rows()
    values = samples(metrics.exposition(here.rows()))
    labels = 'method="GET",endpoint="api/v1/speedups",status="200"'
    name = "frontrunner_request_seconds"
    assert values[f'{name}_bucket{{{labels},le="0.005"}}'] == 1
    assert values[f'{name}_bucket{{{labels},le="0.25"}}'] == 2
    assert values[f'{name}_bucket{{{labels},le="10.0"}}'] == 2
    assert values[f'{name}_bucket{{{labels},le="+Inf"}}'] == values[f"{name}_count{{{labels}}}"] == 3
    assert values[f"{name}_sum{{{labels}}}"] == pytest.approx(70.203)


def test_what_a_dead_process_saw_counts_until_the_service_starts_anew(tmp_path: Path, saved: None) -> None:
    dead, alive = metrics.Registry(), metrics.Registry()
    dead.share(tmp_path, "worker")
    dead.count("problems_total", "api/v1/enrol", "demo_server")
    alive.share(tmp_path, "web")

    assert alive.rows() == {("problems_total", "api/v1/enrol", "demo_server"): [1]}
    metrics.remove_old_copies(tmp_path)
    assert alive.rows() == {}


def test_a_folder_that_takes_nothing_costs_no_request(tmp_path: Path, saved: None) -> None:
    blocked = tmp_path / "metrics"
    blocked.write_text("a file where the folder should be")
    registry = metrics.Registry()
    registry.share(blocked, "web")

    registry.observe("request_seconds", 0.1, *ASKED)
    registry.observe("request_seconds", 0.1, *ASKED)

    assert sum(registry.rows()["request_seconds", *ASKED][:-1]) == 2


def test_labels_are_escaped() -> None:
    assert metrics.label("task", 'a"b\\c\nd') == r'task="a\"b\\c\nd"'


def test_requests_are_counted_by_pattern_and_status_and_refusals_by_their_code(
    client: Client, participant: Participant, alone: None
) -> None:
    requests = 'request_seconds_count{method="POST",endpoint="api/v1/submissions",status="202"}'
    refusals = 'problems_total{endpoint="api/v1/submissions",code="token_missing"}'

    def counts() -> list[float]:
        values = reported(client)
        return [values.get(f"frontrunner_{name}", 0.0) for name in (requests, refusals)]

    assert counts() == [0, 0]
    participant.submit(submission_document())
    assert counts() == [1, 0]
    assert client.post("/api/v1/submissions").json()["code"] == "token_missing"
    assert counts() == [1, 1]


def test_the_running_version_and_this_process_are_reported(
    client: Client, db: None, own_data_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own_data_folder / "metrics").mkdir(exist_ok=True)
    registry = metrics.Registry()
    monkeypatch.setattr(metrics, "registry", registry)
    registry.share(own_data_folder / "metrics", "web")

    values = reported(client)

    assert values[f'frontrunner_build_info{{version="{software_version()}"}}'] == 1
    assert values[f'frontrunner_process_resident_bytes{{kind="web",pid="{os.getpid()}"}}'] > 1e6
    assert values[f'frontrunner_process_open_files{{kind="web",pid="{os.getpid()}"}}'] > 0
    assert values["frontrunner_broker_up"] == 1


@pytest.mark.parametrize("name", ["grafana.json", "prometheus-rules.yml"])
def test_every_series_of_alerts_and_board_is_reported(client: Client, db: None, name: str) -> None:
    series = set(re.findall(r"frontrunner_[a-z_]+", (DEPLOY / name).read_text()))

    reported = set(re.findall(r"^# TYPE (\S+)", client.get("/metrics").content.decode(), re.MULTILINE))
    assert len(series) > 8
    assert {re.sub(r"_seconds_(bucket|sum|count)$", "_seconds", each) for each in series} <= reported


def test_waiting_sessions_are_counted_with_their_age(
    client: Client, participant: Participant, no_worker: None, moment: datetime
) -> None:
    participant.submit(submission_document())
    MeasurementSession.objects.update(received_at=moment - timedelta(minutes=5))

    values = reported(client)

    assert values["frontrunner_sessions_waiting"] == 1
    assert values["frontrunner_oldest_waiting_session_seconds"] == pytest.approx(300)
    assert values["frontrunner_database_up"] == 1
    assert 0 < values["frontrunner_disk_free_bytes"] <= values["frontrunner_disk_size_bytes"]


def test_rows_are_counted_by_a_worker_and_the_counts_have_an_age(
    client: Client, participant: Participant, moment: datetime
) -> None:
    participant.submit(submission_document())
    assert "frontrunner_runs" not in reported(client)
    count_rows()
    RowCount.objects.filter(table="runs").update(at=moment - timedelta(hours=1), seconds=1.0)

    stored = reported(client)
    assert [stored[f"frontrunner_{table}"] for table in ("runs", "sessions", "submissions")] == [4, 1, 1]
    ages = [stored[f'frontrunner_count_age_seconds{{table="{table}"}}'] for table in ("runs", "sessions")]
    assert ages == pytest.approx([3600, 0])

    participant.delete("/me")
    RowCount.objects.update(seconds=0.0)
    assert reported(client)["frontrunner_runs"] == 4
    count_rows()
    counted = reported(client)
    assert [counted[f"frontrunner_{table}"] for table in ("runs", "sessions", "submissions")] == [0, 0, 0]


@pytest.mark.parametrize(
    ("age", "counted"), [(timedelta(minutes=1), 7), (timedelta(hours=1), 0), (-timedelta(days=1), 0)]
)
def test_a_table_that_takes_long_to_count_is_counted_less_often(
    db: None, age: timedelta, counted: int
) -> None:
    RowCount.objects.create(table="runs", rows=7, at=timezone.now() - age, seconds=6.0)

    count_rows()

    assert RowCount.objects.get(table="runs").rows == counted


@pytest.mark.parametrize("path", ["/metrics", "/readyz"])
def test_watching_costs_the_same_however_much_is_stored(
    client: Client, participant: Participant, no_worker: None, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    """The instructions that SQLite executes grow with the rows that it visits."""
    monkeypatch.setattr(session_figures, "WAITING_LIMIT", 2)

    def grow() -> None:
        participant.submit(submission_document(*(session_document() for _ in range(4))))
        # Half of all sessions wait for their first summary, the others for a new one.
        MeasurementSession.objects.filter(
            pk__in=[row.pk for row in MeasurementSession.objects.all()[:2]]
        ).update(summary_algorithm=version.OUTDATED)
        count_rows()

    def instructions() -> int:
        executed = [0]

        def count() -> None:
            executed[0] += 1

        connection.connection.set_progress_handler(count, 1)
        try:
            assert client.get(path).status_code == 200
        finally:
            connection.connection.set_progress_handler(None, 1)
        return executed[0]

    grow()
    few = instructions()
    grow()
    grow()

    assert MeasurementSession.objects.count() == 12
    assert instructions() == few > 0


def test_without_a_database_the_rest_is_still_reported(
    client: Client, monkeypatch: pytest.MonkeyPatch, db: None
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OperationalError("no connection")

    monkeypatch.setattr("crowd.operations.row_counts.RowCount.objects.filter", refuse)

    values = reported(client)

    assert values["frontrunner_database_up"] == 0
    assert "frontrunner_runs" not in values
    assert values["frontrunner_disk_free_bytes"] > 0


WATCHED = pytest.mark.parametrize("path", ["/metrics", "/readyz"])
STRANGER, MONITORING = "198.51.100.9", "10.0.0.5"


@WATCHED
def test_a_direct_request_of_this_machine_may_watch_and_no_other(client: Client, db: None, path: str) -> None:
    here = ("127.0.0.1", "127.1.2.3", "::1", "::ffff:127.0.0.1")
    proxies = ("X-Forwarded-For", "Forwarded", "X-Real-IP")  # that run on this machine

    direct = {address: client.get(path, REMOTE_ADDR=address).status_code for address in (*here, STRANGER)}
    passed_on = {name: client.get(path, headers={name: "127.0.0.1"}).status_code for name in proxies}

    assert direct == dict.fromkeys(here, 200) | {STRANGER: 404}
    assert passed_on == dict.fromkeys(proxies, 404)
    assert client.get("/healthz", REMOTE_ADDR=STRANGER).status_code == 200


@WATCHED
def test_networks_that_are_named_may_watch(client: Client, db: None, settings: Any, path: str) -> None:
    settings.FRONTRUNNER_WATCHERS = (ip_network("10.0.0.0/24"), ip_network("fd00::/8"))

    asked = {
        address: client.get(path, REMOTE_ADDR=address).status_code
        for address in (MONITORING, "fd00::1", STRANGER)
    }

    assert asked == {MONITORING: 200, "fd00::1": 200, STRANGER: 404}


@WATCHED
def test_only_a_trusted_proxy_names_who_watches(
    client: Client, db: None, settings: Any, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    settings.FRONTRUNNER_WATCHERS = (ip_network(MONITORING),)
    headers = {"X-Forwarded-For": MONITORING}

    assert client.get(path, headers=headers, REMOTE_ADDR=STRANGER).status_code == 404
    monkeypatch.setattr(api_settings, "NUM_PROXIES", 1)
    assert client.get(path, headers=headers, REMOTE_ADDR="10.0.0.1").status_code == 200
