"""What the API tells of explorations."""

import csv
import json
from typing import Any

from django.test import Client

from crowd.api_pages.openapi import document as openapi
from crowd.explorations import services
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.outcomes import exports
from tests.builders.explorations import SPACE, finish, record

API = "/api/v1/explorations"


def test_the_api_lists_explorations_and_counts_their_evaluations(
    client: Client, exploration: Exploration, django_assert_num_queries: Any
) -> None:
    finish(services.pending_evaluations(exploration)[:2])

    with django_assert_num_queries(1) as asked:
        answer = client.get(API).json()
    assert 'GROUP BY "explorations_exploration"' not in asked.captured_queries[0]["sql"]

    [row] = answer["results"]
    assert (row["id"], row["state"], row["reference_device"]) == (exploration.pk, "running", "bench")
    assert row["evaluations"] == {"pending": 3, "running": 0, "done": 2, "failed": 0}


def test_the_api_tells_everything_of_one_exploration(
    client: Client, explored: Exploration, django_assert_max_num_queries: Any
) -> None:

    with django_assert_max_num_queries(7):
        answer = client.get(f"{API}/{explored.pk}").json()

    assert answer["space"] == SPACE
    assert answer["state"] == "done"
    assert len(answer["measurements"]) == explored.evaluations.count()
    assert answer["measurements"][0]["label"] == "default"
    runtimes = [row["objectives"]["runtime"] for row in answer["front"]]
    errors = [row["objectives"]["ate_max"] for row in answer["front"]]
    assert runtimes == sorted(runtimes)
    assert errors == sorted(errors, reverse=True)
    assert all(error <= 0.05 for error in errors)


def test_measurements_come_in_pages_each_with_the_front(client: Client, explored: Exploration) -> None:
    numbers, fronts, address = [], [], f"{API}/{explored.pk}?limit=4"

    while address:
        answer = client.get(address).json()
        assert len(answer["measurements"]) <= 4
        numbers += [row["number"] for row in answer["measurements"]]
        fronts.append(answer["front"])
        address = answer["next"]

    assert numbers == list(range(explored.evaluations.count()))
    assert fronts[0]
    assert all(front == fronts[0] for front in fronts)
    assert client.get(f"{API}/{explored.pk}?limit=0").json()["field"] == "limit"
    assert client.get(f"{API}/{explored.pk}?cursor=YWJj").json()["field"] == "cursor"


def test_an_unchanged_exploration_is_not_sent_again(client: Client, exploration: Exploration) -> None:
    first = client.get(f"{API}/{exploration.pk}")
    held = {"If-None-Match": first["ETag"]}

    assert client.get(f"{API}/{exploration.pk}", headers=held).status_code == 304
    finish(services.pending_evaluations(exploration)[:1])
    again = client.get(f"{API}/{exploration.pk}", headers=held)

    assert (again.status_code, again.json()["evaluations"]["done"]) == (200, 1)


def test_another_devices_measurements_are_none_of_this_exploration(
    client: Client, explored: Exploration
) -> None:
    board = ReferenceDevice.objects.create(name="board", queue="board")
    warm = services.create(services.clone(explored, reference_device=board, warm_start_from=explored))

    answer = client.get(f"{API}/{warm.pk}").json()

    assert warm.evaluations.filter(phase="prior").exists()
    assert len(answer["measurements"]) == 5
    assert answer["evaluations"] == {"pending": 5, "running": 0, "done": 0, "failed": 0}


def test_everybody_reads_no_folder_of_the_machine_that_measured(
    client: Client, exploration: Exploration
) -> None:
    Exploration.objects.update(command="python manage.py explore --space /home/anna/space.json")
    failure = "/srv/frontrunner/slam/run.py is gone"
    record(services.pending_evaluations(exploration)[0], failure, worker="host-7:4711")

    text = client.get(f"{API}/{exploration.pk}").content.decode()

    assert "run.py is gone" in text
    assert "--space space.json" in text
    assert not [word for word in ("/srv", "/home", "host-7") if word in text]


def test_an_unknown_exploration_is_a_problem(client: Client, db: None) -> None:
    response = client.get(f"{API}/99")
    assert (response.status_code, response.json()["code"]) == (404, "not_found")


def test_openapi_describes_explorations() -> None:
    described = openapi()
    assert {API, API + "/{key}"} <= set(described["paths"])
    assert "measurements" in json.dumps(described["components"]["schemas"]["ExplorationDetail"])


def test_nobody_reads_that_a_measurement_is_a_check_before_it_is_finished(
    client: Client, exploration: Exploration
) -> None:
    row = exploration.evaluations.order_by("-number").first()
    assert row is not None
    exploration.evaluations.filter(pk=row.pk).update(phase="check")

    def public() -> list[str]:
        """The phase in the API, in both downloads, and in the page's text."""
        objects = "".join(exports.json_lines(exploration))
        table = list(csv.DictReader("".join(exports.csv_lines(exploration)).splitlines()))
        answer = client.get(f"{API}/{exploration.pk}").json()["measurements"]
        page = client.get(f"/explorations/{exploration.pk}/").content.decode()
        shown = "check" if "<td>check</td>" in page else ""
        return [answer[-1]["phase"], json.loads(objects)[-1]["phase"], table[-1]["phase"], shown]

    assert public() == [""] * 4
    finish([row])
    assert public() == ["check"] * 4
