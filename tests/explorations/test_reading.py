"""What the API tells of explorations."""

import json
from typing import Any

from django.test import Client

from crowd.explorations import services
from crowd.explorations.models import Exploration
from crowd.openapi import document as openapi
from tests.explorations.conftest import SPACE, finish, run_to_the_end

API = "/api/v1/explorations"


def test_the_api_lists_explorations_and_counts_their_evaluations(
    client: Client, exploration: Exploration, django_assert_num_queries: Any
) -> None:
    finish(services.waiting(exploration)[:2])

    with django_assert_num_queries(1):
        answer = client.get(API).json()

    [row] = answer["results"]
    assert (row["id"], row["state"], row["reference_device"]) == (exploration.pk, "running", "bench")
    assert row["evaluations"] == {"pending": 3, "running": 0, "done": 2, "failed": 0}


def test_the_api_tells_everything_of_one_exploration(
    client: Client, exploration: Exploration, django_assert_num_queries: Any
) -> None:
    run_to_the_end(exploration)

    with django_assert_num_queries(2):
        answer = client.get(f"{API}/{exploration.pk}").json()

    assert answer["space"] == SPACE
    assert answer["state"] == "done"
    assert len(answer["measurements"]) == exploration.evaluations.count()
    assert answer["measurements"][0]["label"] == "default"
    runtimes = [row["objectives"]["runtime"] for row in answer["front"]]
    errors = [row["objectives"]["ate_max"] for row in answer["front"]]
    assert runtimes == sorted(runtimes)
    assert errors == sorted(errors, reverse=True)
    assert all(error <= 0.05 for error in errors)


def test_an_unknown_exploration_is_a_problem(client: Client, db: None) -> None:
    response = client.get(f"{API}/99")
    assert (response.status_code, response.json()["code"]) == (404, "not_found")


def test_openapi_describes_explorations() -> None:
    described = openapi()
    assert {API, API + "/{key}"} <= set(described["paths"])
    assert "measurements" in json.dumps(described["components"]["schemas"]["ExplorationDetail"])
