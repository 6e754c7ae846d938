"""kill -9 at bad moments, on the embedded default and on real services: nothing lost, nothing doubled."""

import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.builders.documents import session_document, submission_document
from tests.services.intake import own_runs, prepare, runs_of
from tests.services.program import runs
from tests.services.redis import Redis
from tests.services.serving import Services, Serving
from tests.waiting import until

SUBMISSIONS = 12
CLIENTS = 8


@pytest.fixture
def var(tmp_path: Path, services: Services) -> Path:
    """A prepared data folder."""
    prepare(tmp_path / "var", services)
    return tmp_path / "var"


def sessions(server: Serving) -> int:
    """How many sessions stand behind the speedup of the one device, which is rare and therefore masked."""
    assert until(lambda: server.waiting() == 0)
    _, devices = server.call("GET", "/api/v1/devices")
    (device,) = devices["results"]
    _, answer = server.call("GET", f"/api/v1/devices/{device['slug']}")
    return int(answer["session_count"])


def test_killing_worker_and_web_server_loses_and_doubles_nothing(var: Path, services: Services) -> None:
    documents: list[dict[str, Any]] = [submission_document(session_document()) for _ in range(SUBMISSIONS)]
    with Serving(var, services) as server:
        token = server.enrol()
        sent: list[int] = []

        def participate() -> None:
            for document in documents:
                status = server.submit_until_accepted(token, document)
                sent.append(status)

        client = threading.Thread(target=participate)
        client.start()
        until(lambda: len(sent) >= 2)
        server.kill_child("--beat")
        until(lambda: len(sent) >= 4)
        server.kill_child("granian")
        client.join()

        assert until(lambda: server.waiting() == 0)
        assert set(sent) <= {200, 202}
        assert sessions(server) == SUBMISSIONS
        assert own_runs(server, token) == runs_of(documents)
        _, answer = server.call("GET", "/api/v1/speedups")
        assert answer["results"][0]["speedup"] == pytest.approx(8.0)
        assert "starting it again" in server.said()


def test_one_submission_sent_many_times_at_once_is_stored_once(var: Path, services: Services) -> None:
    document = submission_document()
    with Serving(var, services) as server, ThreadPoolExecutor(CLIENTS) as clients:
        headers = {"Authorization": f"Bearer {server.enrol()}", "Idempotency-Key": "the-same"}

        answers = list(
            clients.map(
                lambda _: server.call("POST", "/api/v1/submissions", document, **headers), range(CLIENTS)
            )
        )

        assert sorted(status for status, _ in answers) == [200] * (CLIENTS - 1) + [202]
        assert all(answer == answers[0][1] for _, answer in answers)
        assert sessions(server) == 1


def test_a_broker_that_dies_with_all_its_messages_loses_nothing(tmp_path: Path, redis: Redis) -> None:
    var, services = tmp_path / "var", {"CELERY_BROKER_URL": redis.url}
    prepare(var, services)
    with Serving(var, services) as server:
        token = server.enrol()
        redis.kill()

        assert server.submit_until_accepted(token, submission_document()) == 202

        assert server.call("GET", "/readyz")[0] == 503
        assert server.waiting() == 1
        redis.start()
        server.kill_child("--beat")  # a new worker sweeps at once; this one would at the next half minute
        assert until(lambda: server.waiting() == 0)
        assert sessions(server) == 1


def test_killing_the_supervisor_takes_everything_along_and_a_new_one_goes_on(
    tmp_path: Path,
) -> None:
    var, services = tmp_path / "var", Services()
    prepare(var, services)
    first = Serving(var, services)
    first.start()
    token = first.enrol()
    first.submit_until_accepted(token, submission_document())
    children = first.pids()
    first.process.send_signal(signal.SIGKILL)
    first.process.wait()

    until(lambda: not any(runs(pid) for pid in children))
    with Serving(var, services) as second:
        assert until(lambda: second.waiting() == 0)
        second.submit_until_accepted(token, submission_document())
        assert until(lambda: second.waiting() == 0)
        assert sessions(second) == 2
