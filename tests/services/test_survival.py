"""kill -9 at bad moments, on the embedded default and on real services: nothing lost, nothing doubled."""

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.builders.documents import session_document, submission_document
from tests.services import intake
from tests.services.intake import LIMITS, own_runs, runs_of
from tests.services.postgresql import PostgreSQL
from tests.services.program import runs
from tests.services.redis import Redis
from tests.services.serving import Serving
from tests.waiting import until

SUBMISSIONS = 12
CLIENTS = 8


@pytest.fixture(scope="module")
def embedded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server of the embedded default."""
    var = tmp_path_factory.mktemp("embedded") / "var"
    intake.prepare(var, {})
    with Serving(var, LIMITS) as running:
        yield running


@pytest.fixture(scope="module")
def real(
    tmp_path_factory: pytest.TempPathFactory, postgresql: PostgreSQL, shared_redis: Redis
) -> Iterator[Serving]:
    """A server on PostgreSQL and Redis."""
    shared_redis.empty()
    var = tmp_path_factory.mktemp("real") / "var"
    with intake.prepared_on(postgresql, var) as url:
        services = {"DATABASE_URL": url, "CELERY_BROKER_URL": shared_redis.url}
        with Serving(var, LIMITS | services) as running:
            yield running


@pytest.fixture(params=["embedded", "real"])
def server(request: pytest.FixtureRequest) -> Serving:
    running: Serving = request.getfixturevalue(request.param)
    return running


def sessions(server: Serving) -> int:
    """How many sessions of the one device are kept, which one installation may have sent."""
    assert until(lambda: server.waiting() == 0)
    _, devices = server.call("GET", "/api/v1/devices")
    if not devices["results"]:
        return 0
    (device,) = devices["results"]
    _, answer = server.call("GET", f"/api/v1/devices/{device['slug']}")
    return int(answer["session_count"])


def test_one_submission_sent_many_times_at_once_is_stored_once(server: Serving) -> None:
    document, before = submission_document(), sessions(server)
    headers = {"Authorization": f"Bearer {server.enrol()}", "Idempotency-Key": "the-same"}

    def send(_: int) -> tuple[int, Any]:
        return server.call("POST", "/api/v1/submissions", document, **headers)

    with ThreadPoolExecutor(CLIENTS) as clients:
        answers = list(clients.map(send, range(CLIENTS)))

    assert sorted(status for status, _ in answers) == [200] * (CLIENTS - 1) + [202]
    assert all(answer == answers[0][1] for _, answer in answers)
    assert sessions(server) == before + 1


def test_killing_worker_and_web_server_loses_and_doubles_nothing(server: Serving) -> None:
    documents: list[dict[str, Any]] = [submission_document(session_document()) for _ in range(SUBMISSIONS)]
    token, before = server.enrol(), sessions(server)
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

    assert set(sent) <= {200, 202}
    assert sessions(server) == before + SUBMISSIONS
    assert own_runs(server, token) == runs_of(documents)
    _, answer = server.call("GET", "/api/v1/speedups")
    assert answer["results"][0]["speedup"] == pytest.approx(8.0)
    assert "starting it again" in server.said()


def test_a_broker_that_dies_with_all_its_messages_loses_nothing(real: Serving, shared_redis: Redis) -> None:
    token, before = real.enrol(), sessions(real)
    shared_redis.kill()

    assert real.submit_until_accepted(token, submission_document()) == 202

    assert real.call("GET", "/readyz")[0] == 503
    assert real.waiting() == 1
    shared_redis.start()
    real.kill_child("--beat")  # a new worker sweeps at once; this one would at the next half minute
    assert sessions(real) == before + 1


def test_killing_the_supervisor_takes_everything_along_and_a_new_one_goes_on(embedded: Serving) -> None:
    token, before = embedded.enrol(), sessions(embedded)
    embedded.submit_until_accepted(token, submission_document())
    children = embedded.pids()
    embedded.process.send_signal(signal.SIGKILL)
    embedded.process.wait()

    until(lambda: not any(runs(pid) for pid in children))
    embedded.start()
    assert sessions(embedded) == before + 1
    embedded.submit_until_accepted(token, submission_document())
    assert sessions(embedded) == before + 2
