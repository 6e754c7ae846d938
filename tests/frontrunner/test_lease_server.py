"""Configurations of a user's program as evaluations that workers lease."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import Evaluation
from frontrunner.lease_server import HostedProgram, device_name
from pareto import Explorer, Objective, Space
from pareto.errors import EvaluationError, InfeasibleError
from pareto.fronts.censored import Censored
from pareto.measuring.hosts import Hosting
from pareto.search.stopping import Condition

pytestmark = pytest.mark.django_db(transaction=True)

COMMAND = "./measure {config}"
SPACE = Space.from_dict(
    {
        "parameters": [
            {"name": "x", "type": "real", "minimum": 0, "maximum": 1},
            {"name": "fast", "type": "boolean"},
            {"name": "y", "type": "ordinal", "values": [1, 2], "condition": "fast"},
        ]
    }
)
POINT = SPACE.default


@pytest.fixture
def hosting(tmp_path: Path) -> Hosting:
    explorer = Explorer(SPACE, ["cost", Objective("gain/s", True), "runtime_ratio"])
    return Hosting("127.0.0.1", 8766, tmp_path, COMMAND, explorer, ("valid", "yes"), 60.0, 5.0, 2)


@pytest.fixture
def ask(client: Client, hosting: Hosting) -> Any:
    """A function that sends a request with the token of the search's workers."""
    headers = {"Authorization": f"Bearer {issue_token(HostedProgram(hosting).device)}"}

    def post(path: str, document: Any) -> Any:
        return client.post(f"/api/v1/leases{path}", document, "application/json", headers=headers)

    return post


def leased(ask: Any, hosting: Hosting, conditions: Sequence[Condition] = ()) -> dict[str, Any]:
    """The lease of POINT, for which a search was waiting when it ended."""
    program = HostedProgram(hosting)
    program.end()
    with pytest.raises(EvaluationError, match="the search has ended"):
        program(POINT, {}, conditions)
    response = ask("", {"device": device_name(COMMAND), "lease_version": 2})
    assert response.status_code == 201, response.content
    lease: dict[str, Any] = response.json()
    return lease


def test_a_lease_has_what_a_program_needs_and_no_command(ask: Any, hosting: Hosting) -> None:
    lease = leased(ask, hosting)
    assert (lease["configuration"], lease["objectives"]) == (POINT, ["cost", "gain/s", "runtime_ratio"])
    assert (lease["feasible"], lease["sequences"]) == (["valid", "yes"], [])
    assert "measure" not in str(lease)


def test_a_result_waits_for_the_search_that_goes_on_and_is_used_once(ask: Any, hosting: Hosting) -> None:
    lease = leased(ask, hosting)
    found = {"cost": -2.5, "gain/s": 4, "runtime_ratio": 2}
    result = {"status": "done", "values": {**found, "more": 1}, "configuration": POINT}
    for _ in range(2):  # sent again, it changes nothing
        assert ask(f"/{lease['id']}/result", result).json() == {"state": "done"}
    values = HostedProgram(hosting)(POINT, {}, ())
    assert values == found
    hosting.explorer.tell([POINT], [values], phase="random")
    later = HostedProgram(hosting)
    later.end()
    with pytest.raises(EvaluationError, match="ended"):
        later(POINT, {}, ())
    assert [row.state for row in Evaluation.objects.order_by("number")] == ["done", "pending"]


ENDED = {"cost": 5.0, "gain/s": 1.5, "runtime_ratio": 2.0}


def test_what_ended_early_is_a_bound_for_the_search(ask: Any, hosting: Hosting) -> None:
    lease = leased(ask, hosting, [{"cost": 7.0}, {"gain/s": 2.0}])
    assert (lease["stop_above"], lease["maximised"]) == ([{"cost": 7.0}, {"gain/s": 2.0}], ["gain/s"])
    assert lease["grace_seconds"] == hosting.grace
    result = {"status": "done", "values": ENDED, "censored": ["gain/s"], "stopped_at": 4}
    assert ask(f"/{lease['id']}/result", result).status_code == 200
    values = HostedProgram(hosting)(POINT, {}, ())
    assert values == ENDED
    assert [name for name, value in values.items() if isinstance(value, Censored)] == ["gain/s"]
    assert Evaluation.objects.get().parts == [{"stopped_at": 4, "censored": ["gain/s"]}]


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"censored": ["gain"], "stopped_at": 4}, "censored names gain, which is not an objective"),
        ({"censored": ["gain/s"]}, "censored names gain/s: also send stopped_at"),
        ({"censored": ["gain/s"], "stopped_at": 4}, "ended after 4 reports: let it run until a condition"),
    ],
)
def test_an_early_end_without_a_broken_condition_is_refused(
    ask: Any, hosting: Hosting, more: dict[str, Any], reason: str
) -> None:
    lease = leased(ask, hosting, [{"gain/s": 1.0}])
    response = ask(f"/{lease['id']}/result", {"status": "done", "values": ENDED, **more})
    assert response.status_code == 400
    assert reason in response.json()["detail"]
    assert Evaluation.objects.get().state == "running"


def test_failures_keep_their_reason_and_infeasible_ones_are_marked(ask: Any, hosting: Hosting) -> None:
    lease = leased(ask, hosting)
    ask(f"/{lease['id']}/result", {"status": "failed", "error": "valid is false", "configuration": POINT})
    with pytest.raises(InfeasibleError, match="valid is false"):
        HostedProgram(hosting)(POINT, {}, ())
    hosting.explorer.tell([POINT], [None], phase="random")
    lease = leased(ask, hosting)
    ask(f"/{lease['id']}/result", {"status": "failed", "error": "exit code 3: no memory"})
    with pytest.raises(EvaluationError, match="exit code 3: no memory") as caught:
        HostedProgram(hosting)(POINT, {}, ())
    assert not isinstance(caught.value, InfeasibleError)


def test_a_worker_with_another_command_gets_nothing(ask: Any, hosting: Hosting) -> None:
    leased(ask, hosting)
    response = ask("", {"device": device_name(f"{COMMAND} -v"), "lease_version": 2})
    assert (response.status_code, response.json()["code"]) == (403, "another_device")


def test_a_result_that_lacks_an_objective_is_refused(ask: Any, hosting: Hosting) -> None:
    lease = leased(ask, hosting)
    response = ask(f"/{lease['id']}/result", {"status": "done", "values": {"cost": 1, "runtime_ratio": 1}})
    assert response.status_code == 400
    assert "values lack gain/s" in response.json()["detail"]


def test_the_search_s_server_has_leases_and_nothing_else(client: Client, settings: Any) -> None:
    settings.ROOT_URLCONF = "frontrunner.lease_urls"
    assert client.get("/healthz").status_code == 200
    assert client.post("/api/v1/leases").status_code == 401
    for address in ("/", "/admin/", "/api/v1/explorations", "/api/v1/docs"):
        assert client.get(address).status_code == 404
