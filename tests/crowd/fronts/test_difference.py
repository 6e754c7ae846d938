"""What a version gained and lost against another."""

from math import log
from typing import Any

import pytest
from django.test import Client

from crowd.fronts import selectors
from crowd.fronts.content.difference import Difference, difference
from crowd.fronts.publishing import services
from tests.builders.documents import STANDARD, front_document, prepared

FASTER = {
    "name": "best",
    "parameters": STANDARD | {"compute_size_ratio": 8},
    "predicted": {"runtime": 0.005, "ate_max": 0.02, "ate_mean": 0.01},
}


@pytest.fixture
def compared(db: None, pack: dict[str, Any]) -> Difference:
    """A second version with another best, whose default was measured again, and without the accurate one."""
    first = front_document(pack, version="1")
    second = front_document(pack, version="2", pairs=4, provenance={"device": "another"})
    default = first["configurations"][0] | {
        "predicted": {"runtime": 0.07, "ate_max": 0.01, "ate_mean": 0.005}
    }
    was_best = first["configurations"][1] | {"name": "front-01"}
    second["configurations"] = [prepared(point) for point in (default, FASTER, was_best)]
    for document in (first, second):
        services.publish_content(document)
    old, new = selectors.front("kfusion-1"), selectors.front("kfusion-2")
    assert old is not None
    assert new is not None
    return difference(old, new)


def test_points_are_matched_by_their_parameters(compared: Difference) -> None:
    assert [point.name for point in compared.gained] == ["best"]
    assert [point.name for point in compared.lost] == ["accurate"]
    assert [(pair.old.name, pair.new.name) for pair in compared.changed] == [
        ("default", "default"),
        ("best", "front-01"),
    ]
    (best,) = compared.redefined
    assert best.name == "best"
    assert best.parameters == {
        "compute_size_ratio": (4, 8),
        "volume_resolution": (128, 256),
        "integration_rate": (20, 2),
    }


def test_both_are_shares_of_one_rectangle_on_logarithmic_axes(compared: Difference) -> None:
    # The faster best (2 cm, 5 ms) and the default (1 cm, 70 ms) bound it; the far corner is the limit at the
    # slower default.
    assert compared.rectangle == ((0.01, 0.005), (0.05, 0.08))
    whole = log(0.05 / 0.01) * log(0.08 / 0.005)
    # Old: best (4 cm, 10 ms); its default is not faster than the corner.
    assert compared.old_coverage == pytest.approx(log(0.05 / 0.04) * log(0.08 / 0.01) / whole)
    # New: best, and left of it the default; what was best is dominated.
    left = log(0.02 / 0.01) * log(0.08 / 0.07)
    assert compared.new_coverage == pytest.approx((log(0.05 / 0.02) * log(0.08 / 0.005) + left) / whole)
    assert compared.growth == pytest.approx((compared.new_coverage or 0.0) / (compared.old_coverage or 1.0))


def test_what_clients_would_meet_differently_is_listed(compared: Difference) -> None:
    assert compared.members == {"protocol repeats": (2, 4)}
    assert compared.caveat == "measured with different devices"


def test_a_version_against_itself_differs_in_nothing(compared: Difference) -> None:
    same = difference(compared.new, compared.new)

    assert (same.gained, same.lost, same.changed, same.redefined) == ((), (), (), ())
    assert (same.members, same.caveat, same.growth) == ({}, "", 1.0)


def test_the_page_of_a_front_compares_it_with_the_one_before(client: Client, compared: Difference) -> None:
    page = client.get("/fronts/kfusion-2/").content.decode()

    assert "Against kfusion-1" in page
    assert "gained" in page
    assert "measured with different devices" in page


def test_the_first_version_is_compared_only_on_request(client: Client, compared: Difference) -> None:
    assert "Nothing was published before" in client.get("/fronts/kfusion-1/").content.decode()
    assert "Against kfusion-2" in client.get("/fronts/kfusion-1/?against=kfusion-2").content.decode()


def test_comparing_with_an_unknown_version_says_which_there_are(client: Client, compared: Difference) -> None:
    answer = client.get("/fronts/kfusion-2/?against=kfusion-7")

    assert answer.status_code == 400
    assert "choose from kfusion-1" in answer.content.decode()
