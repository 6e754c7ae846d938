"""What the page of a device tells beyond its figure, and the addresses of its charts."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard import formats
from crowd.dashboard.content.ranking import rank_configurations
from crowd.dashboard.drawings import devices
from crowd.devices.models import Installation
from crowd.fronts.models import FrontVersion
from crowd.results.privacy.own_page import own_page_path
from crowd.results.reading.rows import DeviceDetail
from tests.builders.documents import run_document, session_document
from tests.builders.measuring import in_balanced_order, measure
from tests.builders.participant import Participant
from tests.builders.rows import device, speedup
from tests.builders.stored import join
from tests.dashboard.reading import read


def detail(*rows: Any) -> DeviceDetail:
    return DeviceDetail(device(), tuple(rows), (), 1, 1, None)


def test_the_winner_is_the_fastest_valid_configuration_of_the_same_front_and_processor() -> None:
    best = speedup(4.0)
    rows = (
        best,
        speedup(6.0, configuration="fast"),
        speedup(9.0, configuration="doubtful", suspect=True),
        speedup(8.0, configuration="elsewhere", processor="pthread-cortex"),
    )

    ranking = rank_configurations(detail(*rows), best)

    assert ranking is not None
    assert (ranking.winner, ranking.winner_speedup, ranking.configurations) == ("fast", 6.0, 3)
    assert (ranking.best_rank, ranking.regret) == (2, 1.5)
    assert [row.configuration for row in ranking.rows] == ["doubtful", "fast", "best"]


def test_where_nothing_beats_it_the_default_wins() -> None:
    slow = speedup(0.8)

    ranking = rank_configurations(detail(slow), slow)

    assert ranking is not None
    assert (ranking.winner, ranking.best_rank) == ("default", 2)
    assert ranking.regret == pytest.approx(1.25)
    assert rank_configurations(detail(), None) is None


@pytest.mark.django_db
def test_the_page_tells_its_place_its_winner_its_drift_and_its_history(
    client: Client, front: FrontVersion
) -> None:
    measure(join(), "Pixel 7", best_us=70_000)
    names = {"default": 80_000, "best": 60_000, "accurate": 50_000}
    runs = in_balanced_order(names)
    samples = [{"t": t, "temperature_c": 30.0 + t, "cpu_mhz": None, "battery": None} for t in (0.0, 4.0)]
    session = measure(join(), "Pixel 8", runs=runs, samples=samples)

    page = read(client, "/devices/google-pixel-8/")

    assert "Rank 1 of 2 device models: it gains the most" in page
    assert "Of 3 configurations accurate is the fastest here: 1.60x; best has rank 2" in page
    assert "n = 6 runs of one session" in page
    assert "n = 2 of temperature" in page
    assert "r44p1 16 1.33x - 1 1" in page
    for drawing in devices.DRAWINGS:
        arguments = session["id"] if "uuid" in drawing.path else "google-pixel-8"
        path = drawing.path.replace("<slug:slug>", arguments).replace("<uuid:uuid>", arguments)
        assert client.get(f"/figures/{path}.json").json()["data"], drawing.name
        assert client.get(f"/tables/{path}.json").json()["rows"], drawing.name


@pytest.mark.django_db
def test_a_device_alone_has_no_crowd_and_says_so(client: Client, participant: Participant) -> None:
    measure(participant)

    page = read(client, "/devices/google-pixel-8/")

    assert "there is no crowd to compare it with" in page
    assert "Only default and best have been measured here. Measure may offer more" in page
    assert "frontrunner measure" not in page  # a phone has no command line


@pytest.mark.parametrize(
    ("os", "handheld"), [("Android", True), ("iPadOS", True), ("Linux", False), ("", False)]
)
def test_phones_and_tablets_are_handheld(os: str, handheld: bool) -> None:
    assert device(os=os).handheld is handheld


@pytest.mark.django_db
def test_its_charts_are_of_the_newest_session_of_best_though_others_follow(
    client: Client, participant: Participant
) -> None:
    counted = measure(participant)
    other = measure(participant, runs=in_balanced_order({"default": 80_000, "accurate": 60_000}))

    page = client.get("/devices/google-pixel-8/").content.decode()

    assert f"/figures/sessions/{counted['id']}/frames.json" in page
    assert f"/figures/sessions/{other['id']}/frames.json" not in page
    assert "other configurations" in page


@pytest.mark.django_db
def test_of_one_session_with_a_wide_interval_every_page_shows_the_range_until_another_narrows_it(
    client: Client, participant: Participant, long_front: FrontVersion
) -> None:
    sent = session_document(long_front.slug, pairs=4)
    for order, microseconds in ((1, 11_000), (2, 12_000), (5, 5_000), (6, 10_000)):
        run = sent["runs"][order]
        sent["runs"][order] = run_document("best", run["repeat"], order, microseconds)
    session = measure(participant, **sent)
    device_page, session_page = "/devices/google-pixel-8/", f"/sessions/{session['id']}/"
    [answer] = client.get(f"/api/v1{session_page.rstrip('/')}").json()["speedups"]
    assert answer["high"] > 1.5 * answer["low"]
    assert answer["state"] == "valid"
    point, interval = formats.speedup(answer["speedup"]), formats.interval(answer["low"], answer["high"])
    own = own_page_path(Installation.objects.get())

    for address in (device_page, session_page, own, "/devices/", "/", "/search/?q=pixel"):
        page = client.get(address).content.decode()
        assert interval in page, address
        assert point not in page, address

    measure(join(), **session_document(long_front.slug, pairs=4, best_us=11_000))
    assert re.search(r"Speedup of best over default \d\.\d\dx", read(client, device_page))
