"""How sure it is that one device, session, front or period is faster than another."""

import math
from typing import Any

import numpy as np
import pytest
from django.test import Client
from scipy import stats

from crowd.dashboard.comparing.differences import FASTER, Difference, between_figures, over_pairs, pairs
from crowd.dashboard.formats import RANGE, TIMES
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.records.uncertainty import Estimate
from crowd.results.figures.statistics import Interval, estimate, ratio_between
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.builders.rows import speedup
from tests.builders.stored import join
from tests.dashboard.reading import read, text

pytestmark = pytest.mark.django_db


def difference(low: float | None, value: float, high: float | None) -> Difference:
    return Difference("A", "B", FASTER, " with best", Interval(value, low, high), "there is one installation")


def test_the_interval_is_that_of_welch() -> None:
    generator = np.random.default_rng(7)
    one, other = generator.normal(0.5, 0.1, 5), generator.normal(0.3, 0.3, 9)
    expected = stats.ttest_ind(one, other, equal_var=False).confidence_interval(0.95)

    found = ratio_between(estimate(one), estimate(other))

    assert found.low == pytest.approx(math.exp(expected.low))
    assert found.high == pytest.approx(math.exp(expected.high))


def test_without_a_variance_there_are_no_bounds() -> None:
    assert ratio_between(estimate([1.0]), estimate([0.5, 0.6])).low is None
    assert ratio_between(Estimate(1, 0, 1), Estimate(1, 0, 1)) == Interval(1.0, None, None)
    with pytest.raises(ValueError, match="no values"):
        estimate([])


@pytest.mark.parametrize(
    ("shown", "sentence"),
    [
        (
            difference(1.1, 1.3, 1.5),
            "A is faster than B by 1.30x (1.10-1.50x) with best. The difference is larger than chance.",
        ),
        (
            difference(0.5, 0.8, 0.9),
            "B is faster than A by 1.25x (1.11-2.00x) with best. The difference is larger than chance.",
        ),
        (
            difference(0.9, 1.1, 1.3),
            "There is no clear difference between A and B with best: the ratio of the first to the second is "
            "1.10x (0.900-1.30x).",
        ),
        (
            difference(None, 1.3, None),
            "A is faster than B by 1.30x with best so far. Whether that is more than chance is not known: "
            "there is one installation.",
        ),
        (
            difference(None, 0.9998, None),
            "There is no difference between A and B with best so far. Whether that is more than chance is "
            "not known: there is one installation.",
        ),
    ],
)
def test_a_finding_is_one_plain_sentence(shown: Difference, sentence: str) -> None:
    assert shown.sentence.replace(TIMES, "x").replace(RANGE, "-") == sentence


def test_pairs_are_devices_that_count_on_both_sides() -> None:
    new = [speedup(6.0, "a"), speedup(9.0, "b"), speedup(5.0, "c", confirmed=False), speedup(2.0, "d")]
    old = [speedup(3.0, "a"), speedup(3.0, "b"), speedup(2.0, "c"), speedup(2.0, "d", processor="other")]

    assert [(pair.new.device.slug, pair.ratio) for pair in pairs(new, old)] == [("b", 3.0), ("a", 2.0)]


def test_many_devices_decide_together_what_one_cannot() -> None:
    def row(value: float, slug: str) -> Any:
        return speedup(value, slug, units=3, deviation=0.05)

    new, old = [row(6.0 + i / 10, f"d{i}") for i in range(8)], [row(5.0 + i / 10, f"d{i}") for i in range(8)]

    together = over_pairs(pairs(new, old), "new", "old", FASTER, "")
    alone = over_pairs(pairs([speedup(6.0, "a")], [speedup(5.0, "a")]), "new", "old", FASTER, "")

    assert together is not None
    assert together.decided
    assert together.ratio.value == pytest.approx(1.17, abs=0.02)
    assert alone is not None
    assert not alone.known
    assert over_pairs([], "new", "old", FASTER, "") is None


def test_a_quotient_is_not_surer_than_the_figures_that_it_divides() -> None:
    one, other = (speedup(4.0, "a", units=3, deviation=0.2), speedup(3.0, "b", units=4, deviation=0.01))

    [gain] = between_figures(["one", "other"], [one, other], [{}, {}])

    assert not gain.decided
    half = math.log(gain.ratio.high or 0) - math.log(gain.ratio.value)
    assert half > stats.t.ppf(0.975, 3) * 0.2 / math.sqrt(3)


def test_two_devices_are_compared_with_significance(client: Client, front: FrontVersion) -> None:
    for best_us in (9_900, 10_000, 10_100):
        measure(join(), "Pixel 8", best_us=best_us)
    for best_us in (39_000, 40_000, 41_000):
        measure(join(), "Pixel 7", best_us=best_us)

    page = read(client, "/compare/?devices=google-pixel-8,google-pixel-7")

    assert "Google Pixel 8 is faster than Google Pixel 7 by 4.00x (" in page
    assert "with best. The difference is larger than chance." in page
    assert "over 3 and 3 independent installations" in page
    assert "Google Pixel 8 gains more than Google Pixel 7 by 4.00x (" in page


def test_two_devices_of_one_person_each_get_only_a_provisional_comparison(
    client: Client, front: FrontVersion
) -> None:
    measure(join(), "Pixel 8")
    measure(join(), "Pixel 7", best_us=40_000)

    page = read(client, "/compare/?devices=google-pixel-8,google-pixel-7")

    assert "Google Pixel 8 is faster than Google Pixel 7 by 4.00x with best so far" in page
    assert "there are 1 and 1 independent installation" in page


def test_without_anything_to_compare_there_is_a_choice(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8")
    measure(join(), "Pixel 7")

    chooser = read(client, "/compare/")
    assert "First device" in chooser
    assert "Before and after a day" in chooser
    assert "Two of the newest sessions Google Pixel 7" in chooser
    typed = client.get("/compare/?first=pixel+8&second=pixel+7")
    assert typed["Location"] == "/compare/?devices=google-pixel-8,google-pixel-7"
    either = text(client.get("/compare/?first=pixel&second=pixel+7"))
    assert "Which “pixel”? Google Pixel 7 Google Pixel 8" in either
    assert "no measured device fits nexus" in read(client, "/compare/?first=nexus&second=pixel+7")
    same = read(client, "/compare/?first=pixel+7&second=google+pixel+7")
    assert "both names mean google-pixel-7: name another device" in same


def test_two_sessions_are_compared_by_their_runs(client: Client, front: FrontVersion) -> None:
    one = measure(join(), "Pixel 8")
    other = measure(join(), "Pixel 8", best_us=20_000)

    page = read(client, f"/compare/?sessions={one['id']}&sessions=http://testserver/sessions/{other['id']}/")

    assert "with best" in page
    assert "Google Pixel 8" in page
    alone = client.get(f"/compare/?sessions={one['id']}")
    assert alone.status_code == 400
    assert "tick two sessions, or give two addresses; these are 1" in text(alone)
    unknown = "00000000-0000-4000-8000-000000000000"
    assert client.get(f"/compare/?sessions={one['id']},{unknown}").status_code == 404
    twice = text(client.get(f"/compare/?sessions={one['id']}&sessions={one['id'].upper()}"))
    assert "these are 1" in twice


def test_ticked_sessions_are_compared_though_the_form_sends_its_empty_fields(
    client: Client, front: FrontVersion
) -> None:
    one, other = measure(join(), "Pixel 8"), measure(join(), "Pixel 7")

    page = read(client, f"/compare/?sessions={one['id']}&sessions={other['id']}&sessions=&sessions=")

    assert "Both sessions" in page


def test_periods_are_compared_on_the_devices_of_both(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8")

    page = read(client, "/compare/?date=2026-01-01")

    assert "Before and after 2026-01-01" in page
    assert "No device has a confirmed figure of both" in page
    wrong = client.get("/compare/?date=soon")
    assert wrong.status_code == 400
    assert "date=soon: give a day as 2026-11-30" in text(wrong)


def test_fronts_of_one_application_are_compared(
    client: Client, front: FrontVersion, pack: dict[str, Any]
) -> None:
    publish_content(front_document(pack, version="2"))

    page = read(client, f"/compare/?fronts={front.slug}&fronts=kfusion-2")

    assert "Two fronts" in page
    unknown = client.get(f"/compare/?fronts={front.slug},nothing")
    assert unknown.status_code == 400
    assert "there is no front nothing" in text(unknown)
