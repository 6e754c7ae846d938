"""Pages with rows that came in through the API, as a visitor without a log-in reads them."""

import re
import uuid
from html import unescape
from typing import Any

import pytest
from django.test import Client

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content, retire
from crowd.results.models import DeviceSpeedup, State
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.builders.documents import (
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
)
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.builders.stored import join
from tests.dashboard.reading import read, text

pytestmark = pytest.mark.django_db


def test_before_a_front_is_published_the_home_page_says_how_to(client: Client) -> None:
    page = read(client, "/")

    assert "No front has been published here yet" in page
    assert "frontrunner admin front publish FILE" in page
    assert "No front has been published here yet." in read(client, "/recommend/")


def test_before_anyone_measured_the_home_page_invites(client: Client, front: FrontVersion) -> None:
    page = read(client, "/")

    assert "How much faster is it on yours?" in page
    assert "-m frontrunner measure \\ --server http://testserver" in page
    assert "This front has not been measured yet" in page


def test_the_headline_is_the_geometric_mean_over_device_models(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8", best_us=40_000)
    measure(join(), "Pixel 7", best_us=10_000)
    measure(join(), "Pixel 7", best_us=10_000)

    page = read(client, "/")

    assert "4.00x faster across 2 devices" in page
    assert "n = 2 devices from 3 sessions, front kfusion-test." in page


def test_every_page_says_what_it_counts_and_the_home_page_leads_with_it(
    client: Client, participant: Participant
) -> None:
    session = measure(participant)

    home = read(client, "/")
    assert "8.00x faster on the first device that tried it" in home
    assert "the mean over device models with a confirmed figure." in home
    assert "8.00x Google Pixel 8" in home
    for address in ("/", "/devices/", "/devices/google-pixel-8/", f"/sessions/{session['id']}/"):
        response = client.get(address)
        figures = re.findall(r"<figure.*?</figure>", response.content.decode(), re.DOTALL)
        assert figures, address
        for figure in figures:
            assert re.search(r"<strong>n = \d+", figure), address
            assert re.search(r'role="(img|group)" aria-label="\w', figure)


def test_the_device_page_shows_its_speedup_and_stages_and_no_raw_strings(
    client: Client, participant: Participant, long_front: FrontVersion
) -> None:
    session = measure(participant, front=long_front.slug, pairs=4)

    page = read(client, "/devices/google-pixel-8/")

    assert "Google Pixel 8" in page
    assert "Speedup of best over default 8.00x 95 % interval of its one session: 8.00-8.00x" in page
    assert "best did not finish in 0 of 1 session, lost the camera in 0" in page
    assert "A frame of default 80.0 ms 12.5 fps, in the newest session that counts" in page
    assert "Raycasting takes 50 % of the time of default" in page
    assert "raycasting 40.0 ms 5.00 ms 8.00x" in page
    assert "3.0 v1.r44p1" not in page
    assert session["id"] in client.get("/devices/google-pixel-8/").content.decode()


def test_three_installations_give_the_device_an_interval(client: Client, front: FrontVersion) -> None:
    for best_us in (9_000, 10_000, 11_000):
        measure(join(), best_us=best_us)

    page = read(client, "/devices/google-pixel-8/")

    (row,) = selectors.speedups(SpeedupFilters()).rows
    assert row.low is not None
    assert "95 % interval" in page
    assert "over 3 independent installations" in page


def test_three_sessions_of_one_installation_give_repeatability_and_no_interval(
    client: Client, participant: Participant
) -> None:
    for best_us in (9_000, 10_000, 11_000):
        measure(participant, best_us=best_us)

    page = read(client, "/devices/google-pixel-8/")

    assert "on this one installation (95 % repeatability over its 3" in page


def test_a_device_whose_best_lost_the_camera_has_no_figure_and_says_why(
    client: Client, participant: Participant
) -> None:
    runs = [
        run_document("default", 0, 0, 80_000),
        run_document("best", 0, 1, 1_000, ate_max=0.4),
        run_document("best", 1, 2, 1_000, ate_max=0.4),
        run_document("default", 1, 3, 80_000),
    ]
    session = measure(participant, runs=runs)

    assert "No session of this device counts yet" in read(client, "/devices/google-pixel-8/")
    assert "the largest trajectory error reached the limit" in read(client, f"/runs/{runs[1]['id']}/")
    assert "the largest trajectory error reached the limit" in read(client, f"/sessions/{session['id']}/")
    listed = read(client, "/devices/").replace("\N{NO-BREAK SPACE}", " ")
    assert "1 session; best did not finish in 0 of 1 session, lost the camera in 1" in listed
    assert "How much faster is it on yours?" in read(client, "/")


def test_a_failed_run_shows_what_the_client_reported_and_no_frames_where_it_has_none(
    client: Client, participant: Participant
) -> None:
    nothing = {"status": "failed", "stages_us": {}, "tracked": None}
    failed = run_document("best", 0, 1, 10_000, failure="out of memory at frame 3", **nothing)
    failed["frame_us"] = [10_000] * 3
    at_once = run_document("best", 1, 2, 10_000, failure="no device", **nothing | {"frame_us": []})
    measure(participant, runs=[run_document("default", 0, 0, 80_000), failed, at_once])

    page = read(client, f"/runs/{failed['id']}/")

    assert "the run did not finish" in page
    assert "out of memory" in page
    assert "at frame 3" not in page
    assert "of 3 frames" in page
    of_other = client.get(f"/runs/{at_once['id']}/")
    assert of_other.status_code == 200
    assert b"<figure" not in of_other.content


def test_no_page_shows_the_version_of_the_client_or_the_platform(
    client: Client, participant: Participant
) -> None:
    device = device_document(opencl_platform="zz platform zz", os_version="zz version zz", cpu="zz cpu zz")
    session = session_document()
    document = submission_document(session, device=device, app_version="0.1.99")
    assert participant.submit(document).status_code == 202
    own = (f"/sessions/{session['id']}/", f"/runs/{session['runs'][0]['id']}/")

    for address in ("/", "/devices/", "/devices/google-pixel-8/", *own):
        page = client.get(address).content.decode()
        for words in ("zz platform zz", "0.1.99", "zz cpu zz"):
            assert words not in page, (address, words)


def test_a_valid_run_shows_its_frames_parameters_and_rule(client: Client, participant: Participant) -> None:
    session = measure(participant)

    page = read(client, f"/runs/{session['runs'][1]['id']}/")

    assert "best , repeat 1" in page
    assert "Computation time a frame 10.0 ms 100 fps; mean over the frames from number 10 on" in page
    assert "95 % of them take at most 10.0 ms, the longest 10.0 ms" in page
    assert "its trajectory stays within 5 cm of the truth" in page
    assert "compute size ratio 4" in page
    assert "Frames tracked 96 of 96 tried. Every frame is tracked" in page
    assert "99 10.0 ms" in page


def test_a_session_shows_its_drift_and_why_it_is_suspect(client: Client, participant: Participant) -> None:
    runs = [
        run_document("default", 0, 0, 80_000),
        run_document("default", 1, 1, 120_000),
        run_document("best", 0, 2, 10_000),
        run_document("best", 1, 3, 15_000),
    ]
    session = measure(participant, runs=runs)

    page = read(client, f"/sessions/{session['id']}/")

    assert "suspect on average it ran earlier or later than the default" in page
    assert "+50.0" in page
    assert "Striped: 1" in read(client, "/")


def test_the_front_page_sets_prediction_beside_the_crowd(client: Client, participant: Participant) -> None:
    measure(participant, best_us=20_000)

    page = read(client, "/fronts/kfusion-test/")

    assert "best 10.0 ms 100 fps 4.00 cm 8.00x (7.77-8.25x) 4.00x 1 0 0 of 1 0 of 1" in page
    assert "default 80.0 ms 12.5 fps 1.00 cm 1.00x - - - - -" in page
    assert "Fastest first. A bar is as long as its value ranks" in page
    assert "best 10.0 ms, 4.00 cm 128" in page.replace("\N{NARROW NO-BREAK SPACE}", " ")
    assert "made up for testing" in page
    assert "first counted frame 10" in page


def test_the_front_page_shows_the_crowd_under_filters(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8", best_us=20_000)
    device = device_document("P30", opencl_device="NVIDIA T4")
    join().submit(submission_document(session_document(best_us=10_000), device=device))

    shown = client.get("/fronts/kfusion-test/?vendor=NVIDIA")

    assert "4.00 cm 8.00x (7.77-8.25x) 5.66x 2 0 0 of 2 0 of 2" in read(client, "/fronts/kfusion-test/")
    assert "(NVIDIA) speedup is the mean over n device models" in text(shown)
    assert "4.00 cm 8.00x (7.77-8.25x) 8.00x 1 0 0 of 1 0 of 1" in text(shown)
    assert 'href="/transfer/?front=kfusion-test&amp;vendor=NVIDIA"' in shown.content.decode()
    assert client.get("/fronts/kfusion-test/?vendor=unknown").status_code == 400
    assert client.get("/fronts/nothing/?vendor=NVIDIA").status_code == 404


def test_fronts_are_listed_with_their_state(
    client: Client, front: FrontVersion, pack: dict[str, Any]
) -> None:
    publish_content(front_document(pack, version="2"))
    retire(front)

    page = read(client, "/fronts/")

    assert "kfusion-2 kfusion published" in page
    assert "kfusion-test kfusion retired" in page


def test_filters_live_in_the_address_and_reach_the_figure(client: Client, participant: Participant) -> None:
    measure(participant)

    shown = client.get("/devices/?gpu=mali&min_sessions=1")
    hidden = client.get("/devices/?gpu=adreno")

    assert '"/figures/speedups.json?gpu=mali"' in shown.content.decode()
    assert 'name="gpu" value="mali"' in shown.content.decode()
    assert "No device matches these filters" in text(hidden)


def test_an_address_under_filters_is_as_short_as_it_can_be(client: Client, front: FrontVersion) -> None:
    by_form = client.get("/devices/?front=&vendor=Mali&soc=&min_sessions=1&suspect=&colour=soc&page=2")
    by_script = client.get("/devices/?vendor=&os=Android&min_sessions=1", headers={"HX-Request": "true"})

    assert (by_form.status_code, by_form["Location"]) == (302, "/devices/?vendor=Mali&colour=soc")
    assert (by_script.status_code, by_script["HX-Push-Url"]) == (200, "/devices/?os=Android")


@pytest.mark.parametrize("query", ["colour=soc&colour=", "colour=&colour=soc", "colour=soc&os=&colour="])
def test_a_form_is_sent_on_once(client: Client, query: str) -> None:
    response = client.get(f"/devices/?{query}")

    assert (response.status_code, response["Location"]) == (302, "/devices/?colour=soc")
    assert client.get(response["Location"]).status_code == 200


def test_an_unknown_front_or_application_is_no_answer(client: Client, front: FrontVersion) -> None:
    for address, name in {
        "/?front=nope": "front=nope: give one of kfusion-test.",
        "/transfer/?front=nope": "front=nope: give one of kfusion-test.",
        "/?application=zzz&os=": "application=zzz: give one of kfusion.",
    }.items():
        response = client.get(address)
        assert response.status_code == 400, address
        assert f"Not understood: {name}" in text(response), address
    assert client.get("/transfer/?front=kfusion-test").status_code == 200


def test_the_crowd_is_parted_by_chip_and_system(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8", best_us=40_000)
    measure(join(), "Pixel 7", best_us=10_000)

    page = client.get("/devices/")

    assert "Mali 4.00x - 4.00x 2 0 0 of 2 0 of 2" in text(page)
    assert 'href="/devices/?vendor=Mali"' in page.content.decode()
    assert 'href="/devices/?os=%22Android%22"' in page.content.decode()
    assert "2 device models (system “Android”)" in read(client, "/devices/?os=%22Android%22").replace(
        "\xa0", " "
    )
    narrowed = client.get("/devices/?os=android&min_sessions=1&soc=").url
    assert 'href="/devices/?vendor=Mali&amp;os=android"' in client.get(narrowed).content.decode()


def test_figures_of_another_configuration_bear_its_name(client: Client, front: FrontVersion) -> None:
    for model in ("Pixel 8", "Pixel 7"):
        measure(join(), model, best_us=40_000)
    accurate = front.configurations.get(name="accurate")
    DeviceSpeedup.objects.update(configuration=accurate, speedup=0.5)

    sent_on = client.get("/?configuration=accurate")
    page = read(client, sent_on["Location"]).replace("\N{NO-BREAK SPACE}", " ")

    assert sent_on["Location"] == "/devices/?configuration=accurate"
    assert "2 device models (configuration accurate): 0.500x as fast with accurate in the mean" in page
    assert "Time of the default over time of accurate" in page
    assert "0.500x faster" not in page
    assert " of best over default" not in page


def test_suspect_figures_are_marked_wherever_they_stand(client: Client, front: FrontVersion) -> None:
    for model in ("Pixel 8", "Pixel 7"):
        measure(join(), model)
    DeviceSpeedup.objects.update(state=State.SUSPECT)

    devices = "devices=google-pixel-8,google-pixel-7"
    assert read(client, f"/compare/?{devices}").count("x suspect") == 2
    names = "configurations=default,best&device=google-pixel-8"
    assert read(client, f"/compare/?{names}").count("x suspect") == 1
    assert read(client, "/devices/").count("Mali-G715 suspect") == 0
    assert len(re.findall(r"Pixel \d suspect", read(client, "/devices/"))) == 2
    assert "0 of 2 0 of 2" in read(client, "/fronts/kfusion-test/")
    assert "4.00 cm 8.00x (7.77-8.25x) - 0 2" in read(client, "/fronts/kfusion-test/")


@pytest.mark.parametrize("query", ["since=yesterday", "min_sessions=0", "min_sessions=many"])
def test_a_filter_that_makes_no_sense_is_named(client: Client, front: FrontVersion, query: str) -> None:
    response = client.get(f"/devices/?{query}")

    assert response.status_code == 400
    assert query in text(response)


def test_what_a_client_sends_is_text_and_never_markup(client: Client, participant: Participant) -> None:
    session = session_document()
    device = device_document("<script>alert(1)</script>", opencl_device="<img src=x>", cpu="{{ 7|add:7 }}")
    participant.submit(submission_document(session, device=device))

    (row,) = selectors.devices()
    for address in ("/", "/devices/", f"/devices/{row.device.slug}/", f"/sessions/{session['id']}/"):
        page = client.get(address).content.decode()
        assert "<script>alert" not in page
        assert "<img src=x>" not in page


@pytest.mark.parametrize(
    "address",
    [
        "/devices/unknown/",
        "/fronts/nothing/",
        f"/runs/{uuid.UUID(int=0)}/",
        f"/sessions/{uuid.UUID(int=0)}/",
        "/figures/fronts/nothing.json",
        f"/figures/runs/{uuid.UUID(int=0)}/stages.json",
        "/nowhere/",
    ],
)
def test_what_does_not_exist_is_404(client: Client, address: str) -> None:
    response = client.get(address)

    assert response.status_code == 404
    if address == "/nowhere/":
        assert "There is nothing at this address" in text(response)
        assert "All devices" in text(response)


def test_the_device_page_leads_with_the_figure_of_its_newest_session(
    client: Client, participant: Participant
) -> None:
    for processor, best_us in (("NVIDIA T4", 4_000), ("Mali-G715", 10_000)):
        device = device_document(opencl_device=processor)
        participant.submit(submission_document(session_document(best_us=best_us), device=device))

    page = read(client, "/devices/google-pixel-8/")

    assert "Speedup of best over default 8.00x" in page
    assert "best 20.0x" in page


def test_every_address_that_the_data_page_names_answers(client: Client, participant: Participant) -> None:
    measure(participant)

    page = client.get("/data/").content.decode()

    addresses = set(re.findall(r'href="(/api/v1/[^"]*)"', page))
    assert len(addresses) >= 6
    for address in addresses:
        assert client.get(unescape(address)).status_code == 200, address
