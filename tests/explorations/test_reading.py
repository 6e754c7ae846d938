"""Fronts from explorations, what the API tells of them, and the administrator's pages."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.test import Client
from django.urls import reverse

from crowd.celery import app
from crowd.explorations import publishing, services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.points import Point, spread
from crowd.fronts import selectors as fronts
from crowd.openapi import document as openapi
from tests.explorations.conftest import SPACE, finish, run_to_the_end

API = "/api/v1/explorations"


def point(runtime: float, error: float, label: str = "", repeats: int = 1) -> Point:
    values = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2}
    return Point({"n": f"{runtime} {error}"}, label, "random", values, repeats + 1, repeats)


def test_names_tell_default_best_and_accurate_and_keep_known_ones() -> None:
    default, fast1, fast2 = (
        point(0.1, 0.01, "default"),
        point(0.02, 0.04, "fast1"),
        point(0.03, 0.06, "fast2"),
    )
    middle, accurate, dominated = point(0.05, 0.02), point(0.2, 0.005), point(0.06, 0.03)
    lost = point(0.001, 0.5)

    named = publishing.name_points([default, fast1, fast2, middle, accurate, dominated, lost])

    assert named == {
        "default": default,
        "best": fast1,
        "accurate": accurate,
        "fast2": fast2,
        "front-01": middle,
    }


def test_once_points_were_measured_again_a_lucky_single_measurement_is_not_published() -> None:
    named = publishing.name_points(
        [point(0.1, 0.01, "default"), point(0.05, 0.01), point(0.01, 0.01, repeats=0)]
    )

    assert named["best"].values["runtime"] == 0.05


def test_no_front_without_a_default_or_without_anything_faster() -> None:
    with pytest.raises(publishing.NothingToPublishError, match="default"):
        publishing.name_points([point(0.1, 0.01)])
    with pytest.raises(publishing.NothingToPublishError, match="faster"):
        publishing.name_points([point(0.1, 0.01, "default"), point(0.05, 0.06), point(0.2, 0.001)])


def test_a_long_front_is_thinned_evenly_and_keeps_its_ends() -> None:
    points = [point(2.0**step, 1.0) for step in range(9)]

    chosen = spread(points, 3)

    assert [row.values["runtime"] for row in chosen] == [1.0, 16.0, 256.0]
    assert spread(points, 20) == points


def test_a_finished_exploration_is_published_as_the_next_version(exploration: Exploration) -> None:
    run_to_the_end(exploration)

    first, second = publishing.publish(exploration), publishing.publish(exploration)

    assert (first.slug, second.slug) == ("kfusion-1", "kfusion-2")
    current = fronts.current("kfusion")
    assert current is not None
    default, best = current.point("default"), current.point("best")
    assert default is not None
    assert best is not None
    assert best.runtime is not None
    assert default.runtime is not None
    assert best.runtime < default.runtime
    assert current.provenance["search"]["method"] == "random"


def test_the_median_of_the_repeats_is_published_and_not_what_chose_the_point(
    exploration: Exploration,
) -> None:
    run_to_the_end(exploration)
    rows = exploration.evaluations.filter(label="default")
    assert rows.count() == 3
    for runtime, row in zip([0.001, 3.0, 5.0], rows, strict=True):
        Evaluation.objects.filter(pk=row.pk).update(objectives={**row.objectives, "runtime": runtime})

    document = publishing.document(exploration, "1")

    assert document["configurations"][0]["predicted"]["runtime"] == 4.0


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


@pytest.fixture
def unread_queues() -> Iterator[None]:
    """Tasks are sent as to a worker, and nobody reads them."""
    app.conf.update(task_always_eager=False)
    yield
    app.conf.update(task_always_eager=True)


@pytest.fixture
def administrator(client: Client, db: None) -> Client:
    client.force_login(get_user_model().objects.create_superuser("root", "", "a password"))
    return client


def test_the_administrator_reads_lists_and_rows(administrator: Client, exploration: Exploration) -> None:
    run_to_the_end(exploration)
    row = exploration.evaluations.first()
    assert row is not None
    for name in ("referencedevice", "exploration", "evaluation"):
        assert administrator.get(reverse(f"admin:explorations_{name}_changelist")).status_code == 200
    for name, key in (("exploration", exploration.pk), ("evaluation", row.pk)):
        assert administrator.get(reverse(f"admin:explorations_{name}_change", args=[key])).status_code == 200


def act(administrator: Client, exploration: Exploration, action: str) -> str:
    response = administrator.post(
        reverse("admin:explorations_exploration_changelist"),
        {"action": action, "_selected_action": [exploration.pk]},
        follow=True,
    )
    assert response.status_code == 200
    return response.content.decode()


def test_the_administrator_publishes_a_front(administrator: Client, exploration: Exploration) -> None:
    assert "the default configuration was not measured" in act(administrator, exploration, "publish_front")
    assert fronts.current("kfusion") is None

    run_to_the_end(exploration)

    assert "Published kfusion-1" in act(administrator, exploration, "publish_front")
    assert fronts.current("kfusion") is not None


def test_the_administrator_stops_an_exploration(administrator: Client, exploration: Exploration) -> None:
    act(administrator, exploration, "stop")
    exploration.refresh_from_db()
    assert exploration.state == "cancelled"


def form(exploration: Exploration, **changes: Any) -> dict[str, Any]:
    fields = (
        "application",
        "sequence",
        "sequence_sha256",
        "method",
        "seed",
        "budget",
        "batch",
        "points",
        "repeats",
    )
    written = {name: getattr(exploration, name) for name in fields}
    for name in ("space", "objectives", "limits"):
        written[name] = json.dumps(getattr(exploration, name))
    return written | {"reference_device": exploration.reference_device.pk} | changes


def test_the_administrator_creates_an_exploration_whose_measurements_are_sent(
    administrator: Client, unsaved: Exploration, unread_queues: None
) -> None:
    address = reverse("admin:explorations_exploration_add")

    refused = administrator.post(address, form(unsaved, sequence="elsewhere"))
    assert "no pack elsewhere" in refused.content.decode()
    assert not Exploration.objects.exists()

    assert administrator.post(address, form(unsaved)).status_code == 302
    created = Exploration.objects.get()
    with app.connection_for_read() as broker, broker.SimpleQueue("bench") as queue:
        sent = [queue.get(block=False).payload[0] for _ in range(queue.qsize())]
    assert sent == [[services.waiting(created)[0].pk]]  # as many as the device has machines
