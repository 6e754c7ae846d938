"""Pages of searches, and when they change."""

import csv
import io
import json
from datetime import timedelta
from typing import Any

import pytest
from django.test import Client
from django.utils import timezone

from crowd.dashboard.drawings import explorations as drawings
from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.measurement import Measurement, MeasurementError
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes.insights import milestone
from crowd.explorations.outcomes.watching import SILENT_AFTER, watch
from tests.builders.searches import KNOWN, exploration, measure
from tests.dashboard.reading import read

pytestmark = pytest.mark.django_db

SEARCHED = [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), (0.01, 0.2)]


@pytest.fixture
def search(pack: dict[str, Any]) -> Exploration:
    """A search of four configurations, nothing measured yet."""
    return exploration(pack)


def record(waiting: Evaluation, runtime: float, ate_max: float) -> None:
    with leases.leased(waiting.pk) as evaluation:
        assert isinstance(evaluation, Evaluation)
        leases.record(evaluation, Measurement({"runtime": runtime, "ate_max": ate_max}, {}, {}))


def test_before_any_search_the_page_says_how_to_start_one(client: Client) -> None:
    page = read(client, "/explorations/")

    assert "This server has not explored anything itself" in page
    assert "manage.py exploration start" in page


def test_a_search_shows_what_it_measured_and_gained(client: Client, search: Exploration) -> None:
    measure(search, KNOWN)
    measure(search, SEARCHED)

    listed = read(client, "/explorations/")
    page = read(client, f"/explorations/{search.pk}/")

    assert f"kfusion {search.pk} running" in listed
    assert "Configurations measured 8 in 9 measurements, of which 1 failed" in page
    assert "Valid among them 5" in page
    assert "On the front 5" in page
    assert "The front is that of all measurements so far." in page
    assert "Fastest valid over the default, on the reference device 10.0x 10.0 ms a frame" in page
    assert "Hypervolume covered" in page
    # Without the columns that no measurement fills.
    assert "given failed - - - fast4 the process ended with signal 6" in page
    assert "8 random done 200 ms 1.00 cm" in page
    assert client.get(f"/figures/explorations/{search.pk}.json").json()["data"]


def test_a_search_says_what_chance_and_learning_found(client: Client, pack: dict[str, Any]) -> None:
    search = exploration(pack, budget=6)
    measure(search, KNOWN)
    measure(search, [(0.03, 0.06), (0.049, 0.05), (0.5, 0.004), (0.02, 0.02), (0.04, 0.01), (0.2, 0.2)])
    learned = search.evaluations.filter(phase="random").order_by("number")[3:]
    search.evaluations.filter(pk__in=[row.pk for row in learned]).update(phase="active")

    page = read(client, f"/explorations/{search.pk}/")
    traces = client.get(f"/figures/explorations/{search.pk}.json").json()["data"]

    assert "Valid by random sampling 2 of 3 tried; 2 of them on the front of random sampling" in page
    assert "Valid by active learning 2 of 3 tried; the fastest of them is 5.00x faster than" in page
    (by_chance,) = [trace for trace in traces if trace["name"] == "front of random samples (2)"]
    assert (by_chance["x"], by_chance["y"]) == ([3.0, 4.9], [60.0, 50.0])


def test_points_measured_again_over_more_frames_do_not_hide_the_other_valid_ones(
    client: Client, search: Exploration
) -> None:
    measure(search, KNOWN)
    measure(search, [(0.03, 0.05), (0.049, 0.01), (0.04, 0.004), (0.01, 0.2)])
    search.evaluations.exclude(number=0).update(frames=100)

    assert "Valid among them 6" in read(client, f"/explorations/{search.pk}/")


def test_a_search_that_has_measured_nothing_yet_says_what_to_expect(
    client: Client, pack: dict[str, Any]
) -> None:
    search = exploration(pack, budget=40)

    page = read(client, f"/explorations/{search.pk}/")

    assert "running 0 of 40 configurations searched." in page
    assert "waiting 5" in page
    assert "The first configuration waits for test-board." in page
    assert "from 20 configurations on, which parameters matter" in page
    assert "data-figure" not in client.get(f"/explorations/{search.pk}/").content.decode()
    with leases.leased(services.pending_evaluations(search)[0].pk):
        assert "test-board measures the first configuration now." in read(
            client, f"/explorations/{search.pk}/"
        )
    services.cancel(search)
    assert "It ended before anything was measured" in read(client, f"/explorations/{search.pk}/")
    for name in ("", "/hypervolume", "/importance", "/predictions/runtime"):
        figure = client.get(f"/figures/explorations/{search.pk}{name}.json").json()
        assert not figure["data"]
        assert figure["layout"]["annotations"][0]["text"] in {
            "Nothing measured yet",
            "Too few measurements",
        }


def test_figures_come_one_after_the_other_and_only_then_are_they_exchanged(
    client: Client, pack: dict[str, Any]
) -> None:
    search = exploration(pack, budget=40)
    address = f"/explorations/{search.pk}/live/"

    def kind() -> str:
        return client.get(address).content.decode().partition('data-kind="')[2].partition('"')[0]

    def figures() -> list[str]:
        parts = client.get(address).content.decode().split('data-figure="/figures/explorations/')[1:]
        return [part.partition('.json"')[0].removeprefix(str(search.pk)) for part in parts]

    kinds = [kind()]
    assert figures() == []
    measure(search, KNOWN)
    kinds.append(kind())
    assert figures() == [""]
    searched = [(0.01 * (number % 7 + 1), 0.01 + 0.001 * number) for number in range(40)]
    for waiting, (ate, runtime) in zip(services.advance(search.pk), searched, strict=True):
        record(waiting, runtime, ate)
        if waiting.number == 10:
            kinds.append(kind())
            assert figures() == ["", "/hypervolume"]
    kinds.append(kind())
    assert figures() == ["", "/hypervolume", "/importance", "/predictions/runtime", "/predictions/ate_max"]
    assert len(set(kinds)) == len(kinds)


def test_a_page_says_which_front_it_shows_and_when_that_changes(client: Client, search: Exploration) -> None:
    Exploration.objects.filter(pk=search.pk).update(repeats=2, points=3)
    measure(search, KNOWN)

    running = read(client, f"/explorations/{search.pk}/")
    measure(search, SEARCHED)
    services.advance(search.pk)
    for waiting in services.pending_evaluations(search):
        record(waiting, 0.02, 0.02)
    services.advance(search.pk)
    done = read(client, f"/explorations/{search.pk}/")

    changes = "It changes once: when the search is done, up to 3 points are measured 2 more times"
    assert changes in running.replace("\N{NO-BREAK SPACE}", " ")
    assert "It changes once" not in done
    assert "that were measured again after the search, by the medians of those measurements" in done


def test_failures_are_counted_by_reason(client: Client, search: Exploration) -> None:
    measure(search, [None] * len(KNOWN))

    page = read(client, f"/explorations/{search.pk}/")

    assert "Why 5 measurements failed Times Reason First 5 the process ended with signal 6 0" in page


def test_folders_of_the_machine_that_measures_are_not_shown(client: Client, search: Exploration) -> None:
    with leases.leased(services.pending_evaluations(search)[0].pk):
        raise MeasurementError("no such file: /home/somebody/packs/room/pack.json")

    page = read(client, f"/explorations/{search.pk}/")

    assert "no such file: pack.json" in page
    assert "somebody" not in page


def test_who_measures_is_shown_and_a_queue_without_a_worker_says_how_to_start_one(
    client: Client, search: Exploration
) -> None:
    assert "celery -A crowd worker -Q test-board -c 1" in read(client, f"/explorations/{search.pk}/")

    with leases.leased(services.pending_evaluations(search)[0].pk, "board:77"):
        page = read(client, f"/explorations/{search.pk}/")

    assert "celery -A crowd worker" not in page
    assert "Being measured now Number For Last heard of Attempt 0 default" in page
    assert "board:77" not in page


def test_staff_sees_which_worker_measures(admin_client: Client, client: Client, search: Exploration) -> None:
    address = f"/explorations/{search.pk}/live/"

    with leases.leased(services.pending_evaluations(search)[0].pk, "board:77"):
        public = client.get(address)["ETag"]
        answer = admin_client.get(address, headers={"If-None-Match": public})

    assert answer.status_code == 200
    assert "board:77" in answer.content.decode()


def test_a_figure_is_not_drawn_again_while_nothing_was_measured(
    client: Client, search: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure(search, KNOWN)
    address = f"/figures/explorations/{search.pk}.json?theme="
    first = client.get(address + "dark")
    etag = first["ETag"]
    with monkeypatch.context() as undrawn:
        undrawn.setattr(drawings, "exploration_plane", lambda *_: pytest.fail("it is drawn again"))
        assert client.get(address + "dark").content == first.content

    with leases.leased(services.advance(search.pk)[0].pk) as taken:
        assert client.get(address + "dark", headers={"If-None-Match": etag}).status_code == 304
        assert client.get(address + "light", headers={"If-None-Match": etag}).status_code == 200
        assert taken is not None
        leases.return_evaluation(taken)
    measure(search, [(0.04, 0.06), (0.03, 0.05), (0.049, 0.01), None])
    assert client.get(address + "dark", headers={"If-None-Match": etag}).status_code == 200


def test_a_device_that_was_heard_of_lately_has_a_worker_and_its_silence_changes_the_page(
    client: Client, search: Exploration
) -> None:
    ReferenceDevice.objects.update(seen_at=timezone.now())
    lately = client.get(f"/explorations/{search.pk}/live/")

    ReferenceDevice.objects.update(seen_at=timezone.now() - 2 * SILENT_AFTER)

    answer = client.get(f"/explorations/{search.pk}/live/", headers={"If-None-Match": lately["ETag"]})
    assert "celery -A crowd worker" not in lately.content.decode()
    assert answer.status_code == 200
    assert "celery -A crowd worker" in answer.content.decode()


def test_the_time_left_is_judged_by_the_last_measurements(pack: dict[str, Any]) -> None:
    search = exploration(pack, budget=40)
    measure(search, KNOWN)
    now = timezone.now()
    Evaluation.objects.filter(finished_at__isnull=False).update(
        started_at=now - timedelta(seconds=30), finished_at=now
    )

    seen = watch(search.pk)

    assert seen is not None
    assert seen.seconds_left == 40 * 30.0
    Exploration.objects.filter(pk=search.pk).update(
        held_out_sequences=[{"name": "workshop", "sha256": "0" * 64}], points=3, repeats=2
    )
    whole = watch(search.pk)
    assert whole is not None
    # Each repeat, of three points and the known ones, runs over twice as many sequences.
    assert whole.seconds_left == (40 + 2 * 2 * (3 + whole.phases["given"])) * 30.0
    services.pause(search)
    paused = watch(search.pk)
    assert paused is not None
    assert paused.seconds_left is None
    assert paused.active


def test_the_live_part_is_sent_again_only_when_something_changed(client: Client, search: Exploration) -> None:
    address = f"/explorations/{search.pk}/live/"
    etag = client.get(address)["ETag"]

    assert client.get(address, headers={"If-None-Match": etag}).status_code == 304
    measure(search, KNOWN)

    changed = client.get(address, headers={"If-None-Match": etag})
    assert changed.status_code == 200
    assert "<html" not in changed.content.decode()
    assert "data-live" in changed.content.decode()


def test_a_finished_search_is_not_asked_about_again(client: Client, search: Exploration) -> None:
    services.cancel(search)

    for address in ("", "live/"):
        assert "data-live" not in client.get(f"/explorations/{search.pk}/{address}").content.decode()


def test_every_evaluation_can_be_downloaded_and_an_unknown_search_is_404(
    client: Client, search: Exploration
) -> None:
    measure(search, KNOWN)

    response = client.get(f"/explorations/{search.pk}/evaluations.csv")
    lines = list(csv.DictReader(io.StringIO(response.getvalue().decode())))
    objects = client.get(f"/explorations/{search.pk}/evaluations.json")

    assert response["Content-Disposition"] == f'attachment; filename="exploration-{search.pk}.csv"'
    assert [line["state"] for line in lines] == ["done"] * 4 + ["failed"]
    assert (lines[0]["label"], lines[0]["volume_resolution"]) == ("default", "256")
    assert (float(lines[0]["runtime"]), float(lines[0]["ate_max"])) == (0.1, 0.02)
    assert lines[4]["error"] == "the process ended with signal 6"
    assert [row["number"] for row in json.loads(objects.getvalue())] == [0, 1, 2, 3, 4]
    for unknown in ("/explorations/77/", "/explorations/77/evaluations.csv", "/figures/explorations/77.json"):
        assert client.get(unknown).status_code == 404, unknown


@pytest.mark.slow
def test_a_large_search_costs_no_more_queries_than_a_small_one(
    client: Client, pack: dict[str, Any], django_assert_max_num_queries: Any
) -> None:
    search = exploration(pack, budget=30)
    measure(search, KNOWN)
    measure(search, [(0.01 * (number % 7 + 1), 0.01 + 0.001 * number) for number in range(30)])

    with django_assert_max_num_queries(10):
        page = read(client, f"/explorations/{search.pk}/")
    with django_assert_max_num_queries(7):
        client.get(f"/explorations/{search.pk}/live/", headers={"If-None-Match": '"other"'})

    assert "of the first 29 configurations" in page
    bars = client.get(f"/figures/explorations/{search.pk}/importance.json").json()["data"]
    assert [bar["name"] for bar in bars] == ["runtime, ms a frame", "maximum trajectory error, cm"]


def test_the_growth_is_the_share_of_the_rectangle_between_the_ideal_point_and_the_limits(
    search: Exploration,
) -> None:
    Exploration.objects.filter(pk=search.pk).update(limits={"ate_max": 0.04, "runtime": 0.4})
    measure(search, KNOWN)
    measure(search, [(0.02, 0.2), None, (0.01, 0.2), (0.02, 0.1)])
    seen = watch(search.pk)
    assert seen is not None

    # Each side of the rectangle, from (1 cm, 0.1 s) to (4 cm, 0.4 s), is halved twice.
    assert drawings.growth_table(seen).rows == [
        (1, pytest.approx(1 / 4)),
        (2, pytest.approx(1 / 4)),
        (3, pytest.approx(1 / 2)),
        (4, pytest.approx(3 / 4)),
    ]


@pytest.mark.parametrize(
    ("measurements", "answer"), [(0, 0), (19, 0), (20, 20), (21, 20), (22, 22), (31, 29), (10_000, 9_807)]
)
def test_models_learn_again_when_there_is_a_tenth_more(measurements: int, answer: int) -> None:
    assert milestone(measurements) == answer
