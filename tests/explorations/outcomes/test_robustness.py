"""What may be called best: it holds on every sequence, and a slight change of the depth decides nothing."""

from typing import Any

import pytest
from django.utils import timezone
from msgspec.structs import replace

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing, robustness
from crowd.explorations.searching import batches, points
from crowd.fronts.content.generalisation import Results, bound, objections
from wire.front import SequenceResult

DEFAULT, QUICK, QUICKER = {"n": "default"}, {"n": "quick"}, {"n": "quicker"}
SEQUENCES = ("tiny", "office", "workshop")  # the last is held out


def parts(errors: tuple[float, ...], runtime: float, lost: int = 0) -> list[dict[str, Any]]:
    """What a measurement keeps of SEQUENCES; so many frames are `lost` on the last."""
    rows = [
        {"sequence": name, "runtime": runtime, "ate_max": error, "ate_mean": error / 2, "lost": 0}
        for name, error in zip(SEQUENCES, errors, strict=True)
    ]
    rows[-1]["lost"] = lost
    return rows


@pytest.fixture
def several(unsaved: Exploration) -> Exploration:
    """An exploration over two sequences with a third held out, stored as if it were done."""
    unsaved.further_sequences = [{"name": "office", "sha256": "0" * 64}]
    unsaved.held_out_sequences = [{"name": "workshop", "sha256": "1" * 64}]
    unsaved.save()
    return unsaved


def measured(exploration: Exploration, configuration: dict[str, str], *repeats: list[dict[str, Any]]) -> None:
    """Store a measurement for each of `repeats`."""
    for number, results in enumerate(repeats):
        learned = results[:2]
        Evaluation.objects.create(
            exploration=exploration,
            number=exploration.evaluations.count(),
            phase=Evaluation.Phase.REPEAT,
            label="default" if configuration == DEFAULT else "",
            configuration=configuration,
            configuration_key=batches.configuration_digest(configuration),
            perturbation=number,
            state=Evaluation.State.DONE,
            finished_at=timezone.now(),
            objectives={
                "runtime": learned[0]["runtime"],
                "ate_max": max(part["ate_max"] for part in learned),
                "ate_mean": max(part["ate_mean"] for part in learned),
            },
            parts=results,
        )


def named(exploration: Exploration) -> dict[str, points.Point]:
    rows = list(exploration.evaluations.all())
    return publishing.name_points(
        points.measured_points(rows), robustness.repeat_robustness(exploration, rows)
    )


def steady(errors: tuple[float, ...], runtime: float) -> tuple[list[dict[str, Any]], ...]:
    return parts(errors, runtime), parts(errors, runtime)


def test_best_is_the_fastest_that_holds_on_held_out_sequences(several: Exploration) -> None:
    measured(several, DEFAULT, *steady((0.002, 0.004, 0.002), 0.02))
    measured(several, QUICK, *steady((0.01, 0.02, 0.012), 0.004))
    measured(several, QUICKER, *steady((0.01, 0.03, 0.014), 0.002))  # 1.4 cm: more than 1.5 * 0.2 + 1

    named_points = named(several)

    assert named_points["best"].configuration == QUICK
    assert QUICKER in [point.configuration for point in named_points.values()]


def test_a_camera_that_is_lost_once_is_never_best(several: Exploration) -> None:
    measured(several, DEFAULT, *steady((0.002, 0.004, 0.002), 0.02))
    measured(several, QUICK, *steady((0.01, 0.02, 0.005), 0.004))
    measured(several, QUICKER, *[parts((0.01, 0.01, 0.005), 0.002, lost=1)] * 2)

    assert named(several)["best"].configuration == QUICK


def test_a_point_on_an_edge_is_not_published(several: Exploration) -> None:
    measured(several, DEFAULT, *steady((0.002, 0.004, 0.002), 0.02))
    measured(several, QUICK, *steady((0.01, 0.02, 0.005), 0.004))
    edge = parts((0.01, 0.01, 0.005), 0.002), parts((0.01, 0.04, 0.005), 0.002)
    measured(several, QUICKER, *edge)

    robust = robustness.repeat_robustness(several, several.evaluations.all())

    assert robust[batches.configuration_digest(QUICKER)].edge == "office"
    assert QUICKER not in [point.configuration for point in named(several).values()]


def test_where_no_point_holds_the_error_gives_the_reason(several: Exploration) -> None:
    measured(several, DEFAULT, *steady((0.002, 0.004, 0.002), 0.02))
    measured(several, QUICK, *steady((0.01, 0.02, 0.3), 0.004))

    with pytest.raises(publishing.NothingToPublishError, match=r"its error on workshop is 30\.0 cm"):
        named(several)


def test_results_are_the_worst_of_all_repeats(several: Exploration) -> None:
    measured(several, QUICK, parts((0.01, 0.02, 0.005), 0.004), parts((0.012, 0.018, 0.006), 0.004, lost=2))

    robust = robustness.repeat_robustness(several, several.evaluations.all())[
        batches.configuration_digest(QUICK)
    ]

    assert robust.results.learned_on == (
        SequenceResult("tiny", 0.012, 0),
        SequenceResult("office", 0.02, 0),
    )
    assert robust.results.held_out == (SequenceResult("workshop", 0.006, 2),)


def test_the_front_holds_results_and_probes(several: Exploration) -> None:
    measured(several, DEFAULT, *steady((0.002, 0.004, 0.002), 0.02))
    measured(several, QUICK, *steady((0.01, 0.02, 0.005), 0.004))
    for number, (error, frames) in enumerate([(0.02, None), (0.01, None), (0.2, None), (0.001, 5)]):
        Evaluation.objects.create(
            exploration=several,
            number=100 + number,
            phase=Evaluation.Phase.ACTIVE,
            configuration={"n": str(number)},
            configuration_key=batches.configuration_digest({"n": str(number)}),
            frames=frames,
            state=Evaluation.State.DONE,
            objectives={"runtime": 0.005 + number, "ate_max": error, "ate_mean": error},
            parts=parts((error, error, error), 0.005 + number)[:2],
            finished_at=timezone.now(),
        )

    document = publishing.front_document(several, "1")

    default, best = document["configurations"][:2]
    assert best["held_out"] == [{"sequence": "workshop", "ate_max": 0.005, "lost": 0}]
    assert [result["sequence"] for result in default["learned_on"]] == ["tiny", "office"]
    assert [pack["name"] for pack in document["provenance"]["held_out"]] == ["workshop"]
    # Valid, and over whole sequences, by speed.
    assert [probe["parameters"]["n"] for probe in document["probes"]] == ["0", "1"]


def test_repeats_run_over_held_out_sequences_and_change_the_depth(exploration: Exploration) -> None:
    rows = services.measure_again(exploration, [(QUICK | {"compute_size_ratio": 1}, "")], 3)

    assert [row.perturbation for row in rows] == [0, 1, 2]


def test_objections() -> None:
    good = SequenceResult("a", 0.02, 0)
    default, both = Results([good], []), Results([good], [good])
    assert bound(0.02) == pytest.approx(0.04)
    assert list(objections(both, both, 0.05)) == []
    [lost] = objections(Results([replace(good, lost=3)], []), default, 0.05)
    assert lost == "tracking is lost in 3 frames of a, with the default in 0"
    [large] = objections(Results([replace(good, ate_max=0.05)], []), default, 0.05)
    assert large == "its error on a is 5.0 cm, not below 5 cm"
    [unknown] = objections(both, default, 0.05)
    assert unknown == "the default was not measured on a"
    [missing] = objections(default, both, 0.05)
    assert missing == "it was not measured on a"


def test_frames_in_the_dark_are_lost_for_every_configuration() -> None:
    dark = SequenceResult("a", 0.02, 14)

    assert list(objections(Results([dark], []), Results([dark], []), 0.05)) == []
    [lost] = objections(Results([replace(dark, lost=15)], []), Results([dark], []), 0.05)
    assert lost == "tracking is lost in 15 frames of a, with the default in 14"
