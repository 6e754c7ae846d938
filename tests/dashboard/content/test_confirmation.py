"""What pages say in every state: nothing measured, nothing confirmed, some confirmed, private."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.content.confirmation import confirmed_first, left_out, requirement
from crowd.devices.models import DeviceModel
from crowd.fronts.models import FrontVersion
from crowd.results.models import DeviceSpeedup, State, Tombstone
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.selectors import Speedups
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.builders.rows import speedup
from tests.builders.stored import join
from tests.dashboard.reading import one_space, plain, text

pytestmark = pytest.mark.django_db

UNCONFIRMED = "unconfirmed : three independent installations have to agree before"


@pytest.fixture(autouse=True)
def quorum(settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3


def confirmed_phone(model: str, best_us: int) -> None:
    for _ in range(3):
        measure(join(), model, best_us=best_us)


def shown(client: Client, address: str) -> list[float]:
    """The lengths of the bars of the figure at `address`."""
    traces = client.get(address).json()["data"]
    return [value for trace in traces if trace["type"] == "bar" for value in trace["x"]]


def test_the_models_left_out_are_counted_once_by_their_state() -> None:
    rows = (
        speedup(9.0, "counted"),
        speedup(8.0, "counted", processor="pthread", processor_class="cpu", confirmed=False),
        speedup(7.0, "waiting", confirmed=False),
        speedup(6.0, "waiting", processor="pthread", processor_class="cpu", suspect=True),
        speedup(5.0, "hot", suspect=True),
        speedup(4.0, "other", configuration="accurate", confirmed=False),
    )
    crowd = Speedups(SpeedupFilters(), "kfusion-test", rows, ())

    found = left_out(crowd)

    assert (found.unconfirmed, found.suspect, found.devices) == (1, 1, 2)
    assert found.devices == crowd.headline.unconfirmed
    assert found.only is None
    assert found.words.replace("\N{NO-BREAK SPACE}", " ") == "1 unconfirmed device and 1 suspect device"


def test_no_unconfirmed_figure_stands_above_one_that_counts() -> None:
    rows = (speedup(23.0, "a", confirmed=False), speedup(9.0, "b", suspect=True), speedup(2.0, "c"))

    assert [row.device.slug for row in confirmed_first(rows)] == ["c", "a", "b"]


@pytest.mark.parametrize(
    ("installations", "words"),
    [
        (1, "one independent installation has to measure it"),
        (2, "two independent installations have to agree"),
        (5, "5 independent installations have to agree"),
    ],
)
def test_the_requirement_is_in_words(settings: Any, installations: int, words: str) -> None:
    settings.FRONTRUNNER_QUORUM = installations

    assert requirement() == words


def test_the_first_device_is_shown_with_its_sessions_interval_and_claims_no_crowd(
    client: Client, participant: Participant, long_front: FrontVersion
) -> None:
    session = session_document(long_front.slug, pairs=4)
    session["runs"][2] |= run_document("best", 1, 2, 10_200)
    session["runs"][5] |= run_document("best", 2, 5, 10_200)
    assert participant.submit(submission_document(session)).status_code == 202
    row = DeviceSpeedup.objects.get()
    assert row.session_low is not None
    assert row.session_low < row.speedup

    page = plain(client, "/")

    assert "Tuned on one machine. One device measured so far: 7.92x faster" in page
    assert f"{UNCONFIRMED} it counts. 1 installation measured it so far." in page
    assert "7.92x Google Pixel 8" in page
    assert "95 % interval of one session" in page
    assert "did not finish on" not in page
    assert "The mean:" not in page
    assert "Hollow: 1 figure unconfirmed , in no mean." in page
    assert "across" not in page.partition("Save, cite")[0]
    assert "Google Pixel 8 Mali-G715, OpenCL unconfirmed 7.92x" in page
    assert "one session 1" in page


def test_a_suspect_figure_is_shown_as_such_and_is_never_the_headline(
    client: Client, participant: Participant
) -> None:
    measure(participant, best_us=2_000)
    DeviceSpeedup.objects.update(state=State.SUSPECT)

    page = plain(client, "/")

    head = page.partition("Measure this device")[0]
    assert "One device measured so far; its figure does not count." in head
    assert "suspect : none of its sessions is valid, so it is in no mean." in head
    assert "40.0x" not in head
    assert "40.0x Google Pixel 8" in page
    assert "Mali-G715, suspect: no session of it is valid" in page


def test_several_unconfirmed_devices_have_a_range_and_no_mean(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8")
    measure(join(), "Pixel 7", best_us=40_000)

    home, devices = plain(client, "/"), plain(client, "/devices/")

    assert "Tuned on one machine. 2 devices measured so far, none confirmed" in home
    assert "2 unconfirmed devices. Three independent installations have to agree before" in home
    assert "The mean:" not in home
    assert "2 unconfirmed devices so far: no figure counts yet, so there is no mean." in devices
    assert UNCONFIRMED in devices


def test_an_invented_figure_changes_no_headline_order_or_breakdown_and_no_site_that_embeds_them(
    client: Client, front: FrontVersion
) -> None:
    confirmed_phone("Pixel 8", 40_000)
    confirmed_phone("Pixel 7", 40_000)
    measure(join(), "Pixel 6", best_us=6_000)

    home = plain(client, "/")
    devices = plain(client, "/devices/")

    assert "2.00x faster across 2 devices" in home
    assert "the mean over device models with a confirmed figure, 95 % interval 1.98-2.02x." in home
    assert "The mean: 6 sessions from 6 networks. Not in it: 1 unconfirmed device." in home
    assert home.index("13.3x") > home.index("2.00x Google Pixel 8")
    table = home.partition("Device Speedup 95 % interval Sessions")[2]
    unconfirmed = table.index("Pixel 6 Mali-G715, OpenCL unconfirmed")
    assert table.index("Pixel 7") < table.index("Pixel 8") < unconfirmed
    assert "Mali 2.00x 1.98-2.02x 2.00x 2 1 0 of 2 0 of 2" in devices
    assert "2 device models: 2.00x faster in the mean" in devices
    assert "Not in it: 1 unconfirmed device." in devices
    tried = "of 2 devices tried from 3 networks or more"
    assert f"Best did not finish on 0 {tried}, lost the camera on 0." in devices
    assert "8.00x (7.77-8.25x) 2.00x 2 1 0 of 2 0 of 2" in plain(client, "/fronts/kfusion-test/")
    embed = client.get("/embed/speedups/")
    assert embed.content.decode().count('<rect class="family-') == 2
    assert "2 devices from 6 sessions; not shown: 1 unconfirmed device" in one_space(text(embed))
    assert shown(client, "/figures/speedups.json") == [2.0, 2.0, 13.3333]
    assert "embedded" not in client.get("/tables/speedups.json").json()["page"]


def test_an_unconfirmed_device_has_no_rank_and_its_page_says_where_it_would_stand(
    client: Client, front: FrontVersion
) -> None:
    confirmed_phone("Pixel 8", 40_000)
    confirmed_phone("Pixel 7", 20_000)
    measure(join(), "Pixel 6", best_us=30_000)

    page = plain(client, "/devices/google-pixel-6/")
    other = plain(client, "/devices/google-pixel-8/")

    assert f"{UNCONFIRMED} it counts. 1 installation measured it so far." in page
    assert "No rank yet: once confirmed it would have rank 2 of 3 device models" in page
    assert "and this one, hollow: unconfirmed ." in page
    assert "Rank 2 of 2 device models: no other gains less" in other
    table = client.get("/tables/devices/google-pixel-6/crowd.json").json()
    assert [(row["device"], row["state"]) for row in table["rows"]] == [
        ("google-pixel-7", "confirmed"),
        ("google-pixel-6", "unconfirmed"),
        ("google-pixel-8", "confirmed"),
    ]
    assert "(unconfirmed)" in table["title"]
    (bars,) = client.get("/figures/devices/google-pixel-6/crowd.json").json()["data"]
    assert bars["marker"]["line"]["width"] == [0, 1.5, 0]


def test_a_suspect_device_has_no_rank_at_all(client: Client, front: FrontVersion) -> None:
    confirmed_phone("Pixel 8", 40_000)
    measure(join(), "Pixel 6")
    DeviceSpeedup.objects.filter(device__name="Pixel 6").update(state=State.SUSPECT)

    page = plain(client, "/devices/google-pixel-6/")

    assert "suspect : none of its sessions is valid, so it is in no mean." in page
    assert "rank " not in page.casefold()


def test_downloads_tell_confirmation_and_suspicion_apart(client: Client, front: FrontVersion) -> None:
    confirmed_phone("Pixel 8", 40_000)
    measure(join(), "Pixel 7")
    measure(join(), "Pixel 6")
    DeviceSpeedup.objects.filter(device__name="Pixel 6").update(state=State.SUSPECT)

    rows = client.get("/tables/speedups.json").json()["rows"]

    assert {row["model"]: (row["state"], row["suspect"]) for row in rows} == {
        "Pixel 8": ("confirmed", False),
        "Pixel 7": ("unconfirmed", False),
        "Pixel 6": ("unconfirmed", True),
    }
    (row,) = client.get("/tables/devices/google-pixel-7/configurations.json").json()["rows"]
    assert (row["state"], row["suspect"], row["processor_class"]) == ("unconfirmed", False, "gpu")


@pytest.mark.parametrize("address", ["/", "/devices/", "/transfer/", "/fronts/kfusion-test/", "/about/"])
def test_a_private_server_says_how_few_installations_it_asks_for(
    client: Client, front: FrontVersion, settings: Any, address: str
) -> None:
    notice = "This server confirms a figure with"
    assert notice not in plain(client, address)

    settings.FRONTRUNNER_QUORUM = 2

    assert f"{notice} 2 installations." in plain(client, address)


def test_failures_stand_beside_the_mean(client: Client, front: FrontVersion) -> None:
    confirmed_phone("Pixel 8", 40_000)
    for model, networks in (("Pixel 7", 3), ("Pixel 6", 2)):
        for _ in range(networks):
            lost = [
                run_document("default", 0, 0, 80_000),
                run_document("best", 0, 1, 1_000, ate_max=0.4),
                run_document("best", 1, 2, 1_000, ate_max=0.4),
                run_document("default", 1, 3, 80_000),
            ]
            measure(join(), model, runs=lost)

    fared = "did not finish on 0 of 2 devices tried from 3 networks or more, lost the camera on 1."
    assert f"Best {fared}" in plain(client, "/")
    assert f"Best {fared}" in plain(client, "/devices/")
    assert "8.00x (7.77-8.25x) 2.00x 1 0 0 of 2 1 of 2" in plain(client, "/fronts/kfusion-test/")
    assert "Best did not finish in 0 of 3 sessions, lost the camera in 3." in plain(
        client, "/devices/google-pixel-7/"
    )


def test_runs_that_were_deleted_one_by_one_are_counted_in_public(
    client: Client, participant: Participant
) -> None:
    session = measure(participant)
    assert "deleted one by one" not in plain(client, "/")
    assert "0 runs were deleted one by one by participants" in plain(client, "/data/")

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")
    Tombstone.objects.update(single=True)

    assert "1 run was deleted one by one by participants" in plain(client, "/")
    assert "1 run was deleted one by one by participants" in plain(client, "/data/")


def test_a_masked_device_says_why_it_has_no_name(
    client: Client, participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    measure(participant)
    DeviceModel.objects.update(rare=True)

    home = client.get("/")
    (slug,) = set(re.findall(r'"/devices/([a-z0-9-]+)/"', home.content.decode()))
    page = plain(client, f"/devices/{slug}/")

    assert "Pixel" not in page + text(home)
    assert "This model is shown by its chip only: fewer than 5 installations measured it" in page
