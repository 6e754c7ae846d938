"""What those who run a real server see of it: its logs and its metrics."""

import json
from pathlib import Path
from typing import Any

from tests.builders.documents import submission_document
from tests.services import intake
from tests.services.intake import SUBMISSIONS
from tests.services.serving import Serving
from tests.waiting import until


def entries(log: Path) -> list[dict[str, Any]]:
    """The JSON lines of `log`; what else was printed there is left out."""
    return [json.loads(line) for line in log.read_text().splitlines() if line.startswith("{")]


def test_one_id_leads_from_the_request_to_the_tasks_that_it_caused(shared_server: Serving) -> None:
    token = shared_server.enrol()
    headers = {
        "Authorization": f"Bearer {token}",
        "Idempotency-Key": "one",
        "X-Request-ID": "upload-0001",
    }
    status, _ = shared_server.call("POST", SUBMISSIONS, submission_document(), **headers)
    assert status == 202
    worker, web = (shared_server.var / "logs" / name for name in ("worker.log", "web.log"))

    def summarised() -> bool:
        caused = [entry for entry in entries(worker) if entry.get("request_id") == "upload-0001"]
        return any("summarise" in entry["message"] for entry in caused)

    assert until(summarised)
    (line,) = [entry for entry in entries(web) if entry.get("request_id") == "upload-0001"]
    assert line["message"] == "POST /api/v1/submissions 202"
    for log in (web, worker):
        assert token not in log.read_text()
        assert "127.0.0.1" not in log.read_text()


def copied(folder: Path, metric: str, label: str) -> float:
    """How often processes have left copies of that metric with that label in `folder`."""
    rows = [row for path in folder.glob("*.json") for row in json.loads(path.read_text())]
    return sum(sum(row[:-1]) for (name, *labels), row in rows if name == metric and label in labels)


def test_metrics_add_up_over_processes_and_their_deaths(shared_server: Serving) -> None:
    name = 'frontrunner_request_seconds_count{method="GET",endpoint="api/v1/fronts",status="200"}'

    def counted() -> float:
        text = intake.text_of(shared_server, "/metrics")
        return next((float(line.split()[-1]) for line in text.splitlines() if line.startswith(name)), 0.0)

    before = counted()
    for _ in range(3):
        assert shared_server.call("GET", "/api/v1/fronts")[0] == 200
    until(lambda: counted() == before + 3, seen=counted)
    until(lambda: copied(shared_server.var / "metrics", "request_seconds", "api/v1/fronts") == before + 3)
    killed = shared_server.pids("granian")
    shared_server.kill_child("granian")
    # What it had started is gone by then too.
    until(lambda: shared_server.pids("granian") not in ([], killed))
    until(lambda: intake.answers(shared_server))
    assert shared_server.call("GET", "/api/v1/fronts")[0] == 200
    until(lambda: counted() == before + 4, seen=counted)


def test_tasks_of_the_worker_are_counted(shared_server: Serving) -> None:
    sweep = "crowd.results.tasks.sweep"
    until(lambda: copied(shared_server.var / "metrics", "task_seconds", sweep) > 0)

    text = intake.text_of(shared_server, "/metrics")
    assert f'frontrunner_task_seconds_count{{task="{sweep}",state="success"}}' in text
    assert 'frontrunner_process_resident_bytes{kind="worker"' in text
    assert 'frontrunner_queue_messages{queue="crowd"}' in text
