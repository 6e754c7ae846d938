"""Fronts that say where they hold: results by sequence, the rule for best, and probes."""

import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.fronts import selectors
from crowd.fronts.content import front_file
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services
from crowd.operations import first_run
from crowd.results.reading import selectors as selectors_of_results
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.builders.crowds import Join, send
from tests.builders.documents import (
    STANDARD,
    front_document,
    prepared,
    run_document,
    session_document,
    trajectory,
)
from tests.builders.measuring import in_balanced_order
from tests.builders.participant import API, Participant
from tests.dashboard.reading import read


def result(sequence: str, error: float, lost: int = 0) -> dict[str, Any]:
    return {"sequence": sequence, "ate_max": error, "lost": lost}


def document(pack: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A front that was learned on two sequences and checked on a third, with two probes."""
    content = front_document(pack) | changes
    for point, errors in zip(
        content["configurations"],
        [(0.01, 0.002, 0.004), (0.03, 0.04, 0.015), (0.008, 0.002, 0.3)],
        strict=True,
    ):
        point["learned_on"] = [result(pack["name"], errors[0]), result("office", errors[1])]
        point["held_out"] = [result("workshop", errors[2], lost=7 if errors[2] > 0.1 else 0)]
    content["provenance"] |= {
        "sequences": [
            {"name": pack["name"], "sha256": pack["sha256"]},
            {"name": "office", "sha256": "0" * 64},
        ],
        "held_out": [{"name": "workshop", "sha256": "1" * 64}],
    }
    content["probes"] = [
        prepared(
            {
                "name": f"probe-0{number}",
                "parameters": STANDARD | {"tracking_rate": number},
                "predicted": {"runtime": 0.04, "ate_max": 0.02, "ate_mean": 0.01},
                "trajectory": trajectory(0.01 * number),
            }
        )
        for number in (2, 3)
    ]
    return content


@pytest.fixture
def front(db: None, pack: dict[str, Any]) -> FrontVersion:
    return services.publish_content(document(pack))[0]


def test_results_and_probes_survive_a_round_trip(front: FrontVersion, pack: dict[str, Any]) -> None:
    stored = selectors.front_in_any_state(front.pk)

    again = selectors.content(stored)

    assert again == front_file.check(document(pack))
    assert front_file.digest(again) == front.digest
    assert [point.name for point in stored.points] == ["default", "best", "accurate"]
    assert [point.name for point in stored.probes] == ["probe-02", "probe-03"]


def test_a_front_without_results_keeps_its_digest(pack: dict[str, Any]) -> None:
    plain = front_document(pack)

    without, empty = (front_file.check(plain | more) for more in ({}, {"probes": []}))
    assert front_file.digest(without) == front_file.digest(empty)
    assert "probes" not in front_file.document(empty)


@pytest.mark.parametrize(
    ("member", "results", "complaint"),
    [
        ("held_out", [result("workshop", 0.017)], "more than 1.6 cm"),
        (
            "held_out",
            [result("workshop", 0.001, lost=1)],
            "tracking is lost in 1 frames of workshop, with the default in 0",
        ),
        ("held_out", [result("library", 0.001)], "the default was not measured on library"),
        ("held_out", [], "it was not measured on workshop"),
        ("learned_on", [result("test-sequence", 0.03), result("office", 0.05)], "not below 5 cm"),
        ("learned_on", [result("office", 0.01)], "it was not measured on test-sequence"),
        (
            "held_out",
            [result("workshop", 0.001)] * 2,
            r"configurations\[1\]\.held_out of best: sequences repeat",
        ),
    ],
)
def test_best_must_hold_on_every_sequence(
    db: None, pack: dict[str, Any], member: str, results: list[dict[str, Any]], complaint: str
) -> None:
    changed = document(pack)
    changed["configurations"][1][member] = results

    with pytest.raises(InvalidFrontError, match=complaint):
        services.create_draft(changed)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"name": "best"}, "names repeat"),
        ({"band": -1.0}, r"probes\[0\]\.band"),
        ({"parameters": STANDARD | {"mu": -1}}, r"probes\[0\]\.parameters of probe-02: mu"),
    ],
)
def test_a_wrong_probe_is_named(
    db: None, pack: dict[str, Any], change: dict[str, Any], complaint: str
) -> None:
    changed = document(pack)
    changed["probes"][0] |= change

    with pytest.raises(InvalidFrontError, match=complaint):
        services.create_draft(changed)


@pytest.mark.parametrize("member", ["sequences", "held_out"])
@pytest.mark.parametrize("packs", [3, "living-room", ["living-room"], [{"name": "living-room"}]])
def test_sequences_that_no_page_could_show_are_refused(
    db: None, pack: dict[str, Any], member: str, packs: Any
) -> None:
    changed = document(pack)
    changed["provenance"][member] = packs

    with pytest.raises(InvalidFrontError, match=rf"provenance\.{member}: give a list"):
        services.create_draft(changed)


def test_the_manifest_omits_probes_but_clients_may_send_them(
    front: FrontVersion, participant: Participant
) -> None:
    manifest = participant.get("/manifest").json()
    assert [point["name"] for point in manifest["configurations"]] == ["default", "best", "accurate"]
    session = session_document()
    session["runs"] += [run_document("probe-02", repeat, 4 + repeat, 40_000) for repeat in range(2)]

    answer = send(participant, session)

    assert {item["status"] for item in answer.json()["items"]} == {"accepted"}


def test_the_api_and_the_page_tell_where_a_front_holds(front: FrontVersion, client: Client) -> None:
    detail = client.get(f"{API}/fronts/{front.slug}").json()
    page = read(client, f"/fronts/{front.slug}/")

    assert detail["configurations"][1]["held_out"] == [result("workshop", 0.015)]
    assert [probe["name"] for probe in detail["probes"]] == ["probe-02", "probe-03"]
    assert "Learned on test-sequence and office; checked on workshop." in page
    assert "true trajectory, on the worst of the sequences learned on." in page
    assert "30.00 cm 7 frames lost" in page


def test_the_page_of_a_front_of_one_sequence_says_so(db: None, pack: dict[str, Any], client: Client) -> None:
    front = services.publish_content(front_document(pack))[0]

    assert "Learned only on test-sequence" in read(client, f"/fronts/{front.slug}/")


def test_the_start_of_a_server_counts_points_without_probes(
    db: None, pack: dict[str, Any], settings: Any, tmp_path: Path
) -> None:
    settings.FRONTRUNNER_FRONTS = tmp_path
    (tmp_path / "kfusion-test.json").write_text(json.dumps(document(pack)))

    assert list(first_run.publish_shipped_fronts()) == ["Published the front kfusion-test: 3 configurations"]


@pytest.mark.parametrize("period", [{}, {"since": date(2026, 11, 1)}])
def test_probes_change_neither_the_speedup_of_best_nor_who_wins(
    front: FrontVersion, join: Join, period: dict[str, Any]
) -> None:
    usual = {"default": 80_000, "best": 10_000, "accurate": 90_000}
    for model, times in (
        ("Pixel 8", usual | {"probe-02": 5_000}),
        ("Pixel 9", {"default": 80_000, "best": 10_000, "probe-02": 5_000}),
    ):
        send(join(), session_document(front.slug, runs=in_balanced_order(times)), device=model)

    winners = selectors_of_results.winners(SpeedupFilters(**period))
    speedups = selectors_of_results.speedups(SpeedupFilters(**period)).rows

    assert [(row.device.slug, row.winner, row.reference_rank) for row in winners.rows] == [
        ("google-pixel-8", "best", 1)
    ]
    assert [row.speedup for row in speedups] == pytest.approx([8.0, 8.0])
