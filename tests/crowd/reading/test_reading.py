"""What pages read of figures: parts of the crowd, a device's place, winners, correlations, history."""

from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from scipy import stats

from crowd.devices import revision
from crowd.devices.models import DeviceModel
from crowd.fronts.models import FrontVersion
from crowd.records.speedup import Speedup
from crowd.results.figures.cohorts import OutcomeCounts
from crowd.results.models import DeviceSpeedup
from crowd.results.reading import aggregates, selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import CohortOutcome, ModelOutcomes
from crowd.results.reading.transferring import correlations
from crowd.results.reading.transferring.correlations import pairwise
from tests.builders import rows as made_up
from tests.builders.crowds import Join
from tests.builders.documents import device_document, run_document, session_document, submission_document
from tests.builders.rows import crowd

WIDE = ("fast", "faster", "fastest")


def bar(slug: str, value: float, **changes: Any) -> Speedup:
    parts = {"gpu": "Adreno 750"} | {
        name: changes.pop(name) for name in ("gpu", "manufacturer") if name in changes
    }
    made = made_up.device(slug, name=slug, **parts)
    processor = {"processor": made.gpu} | changes
    return made_up.speedup(value, slug, device=made, **processor)


def test_the_crowd_is_broken_down_by_who_made_the_chip_that_computed() -> None:
    on_cpu = bar("a", 5.0, processor="AMD EPYC", processor_class="cpu")
    rows = [bar("a", 2.0), bar("b", 8.0), bar("c", 3.0, gpu="Mali-G78"), on_cpu]

    shares = {share.group: share.figure for share in aggregates.breakdown(rows, "vendor")}

    assert list(shares) == ["Adreno", "CPU", "Mali"]
    assert (shares["Adreno"].devices, shares["Adreno"].geometric_mean) == (2, pytest.approx(4.0))
    assert (shares["CPU"].devices, shares["CPU"].geometric_mean) == (1, pytest.approx(5.0))
    assert [share.group for share in aggregates.breakdown(rows, "os")] == ["Android"]


def test_a_breakdown_is_of_the_figures_that_the_headline_is_of() -> None:
    rows = [bar("a", 2.0), bar("b", 8.0, suspect=True), bar("c", 9.0, gpu="Mali-G78", confirmed=False)]

    adreno, mali = aggregates.breakdown(rows, "vendor")

    assert (adreno.group, adreno.figure.devices, adreno.figure.unconfirmed) == ("Adreno", 1, 1)
    assert (mali.group, mali.figure.geometric_mean, mali.figure.unconfirmed) == ("Mali", None, 1)


def test_the_headline_rests_on_confirmed_figures_and_counts_the_others() -> None:
    rows = [bar("a", 2.0), bar("b", 8.0), bar("c", 400.0, confirmed=False), bar("d", 9.0, suspect=True)]

    headline = aggregates.headline(rows)

    assert (headline.devices, headline.unconfirmed, headline.max) == (2, 2, pytest.approx(8.0))
    assert headline.geometric_mean == pytest.approx(4.0)
    assert aggregates.headline(rows[2:]).geometric_mean is None


def test_a_fast_family_of_chips_counts_in_full_and_is_named_beside_the_mean() -> None:
    usual = [bar(f"a{number}", 4.0, units=3, deviation=0.05) for number in range(4)]
    fast = bar("b", 8.0, gpu="Mali-G78", units=3, deviation=0.05)

    summary = crowd(*usual, fast)

    line = summary.headline
    assert line.mean == line.geometric_mean == pytest.approx((4.0**4 * 8.0) ** 0.2)
    assert line.low is not None
    assert line.high is not None
    assert 4.0 < line.low < line.mean < line.high < 5.5
    assert (line.all_low, line.median, line.min, line.max) == (None, *map(pytest.approx, (4.0, 4.0, 8.0)))
    medians = {row.group: row.figure.median for row in summary.breakdowns["vendor"] if row.figure.devices}
    assert medians == {"Adreno": pytest.approx(4.0), "Mali": pytest.approx(8.0)}


def test_a_models_gpu_and_its_cpu_are_never_averaged() -> None:
    rows = [bar("a", 4.0), bar("a", 16.0, processor="AMD EPYC", processor_class="cpu")]

    assert aggregates.headline(rows).geometric_mean == pytest.approx(4.0)
    assert aggregates.headline(rows[1:]).geometric_mean == pytest.approx(16.0)


def test_failures_and_lost_cameras_are_counted_by_models() -> None:
    def ran(slug: str, sessions: int, failed: int, lost: int, configuration: str = "best") -> CohortOutcome:
        device = bar(slug, 1.0).device
        counts = OutcomeCounts(sessions, failed, lost, sessions, failed, lost)
        return CohortOutcome(device, configuration, "opencl", "Mali-G78", "Mali", counts)

    rows = [ran("a", 4, 1, 2), ran("b", 1, 1, 0), ran("c", 3, 0, 1), ran("d", 1, 1, 1, "accurate")]

    assert aggregates.model_outcomes(rows) == ModelOutcomes(devices=3, failing=1, losing=1)


def test_a_devices_place_counts_models_once_and_leaves_suspect_figures_out() -> None:
    rows = [
        bar("a", 2.0),
        bar("b", 8.0),
        bar("b", 2.0, processor="x"),
        bar("c", 9.0),
        bar("d", 99, suspect=True),
        bar("e", 99, confirmed=False),
    ]

    ranking = crowd(*rows).ranking("b")

    assert ranking is not None
    assert (ranking.rank, ranking.speedup, ranking.slower) == (2, pytest.approx(4.0), 0.5)
    assert [device.slug for device, _ in ranking.models] == ["c", "b", "a"]
    assert crowd(*rows).ranking("d") is None
    assert crowd(*rows).ranking("e") is None


def test_an_only_device_has_no_share_of_slower_ones() -> None:
    ranking = crowd(bar("a", 2.0)).ranking("a")

    assert ranking is not None
    assert (ranking.rank, ranking.slower) == (1, None)


def test_pairwise_correlations_are_those_of_scipy_whatever_is_missing() -> None:
    values = np.random.default_rng(7).normal(size=(9, 8)).round(1)
    values[:4, 5:] = np.nan
    values[8, 2:] = np.nan
    pearson, spearman, common = pairwise(values)

    for i, j in np.ndindex(9, 9):
        both = np.isfinite(values[i]) & np.isfinite(values[j])
        assert common[i, j] == both.sum()
        if i == j or both.sum() < 3:
            assert np.isnan(pearson[i, j])
            assert np.isnan(spearman[i, j])
        else:
            x, y = values[i, both], values[j, both]
            assert pearson[i, j] == pytest.approx(stats.pearsonr(x, y)[0])
            assert spearman[i, j] == pytest.approx(stats.spearmanr(x, y)[0])


def test_a_device_that_runs_all_equally_fast_correlates_with_none() -> None:
    pearson, _, common = pairwise(np.array([[1.0, 1.0, 1.0], [1.0, 2.0, 3.0]]))

    assert np.isnan(pearson[0, 1])
    assert common[0, 1] == 3


@pytest.fixture
def measured(front: FrontVersion) -> None:
    """Figures of three devices; best wins on none but the first."""
    configurations = {each.name: each for each in front.configurations.all()}
    for slug, best, accurate, sessions in (
        ("a", 8.0, 0.5, 9),
        ("b", 4.0, 5.0, 3),
        ("c", 0.8, 0.9, 1),
        ("only-best", 4.0, None, 50),
    ):
        device = DeviceModel.objects.create(key=slug, slug=slug, name=slug, named=True, rare=False)
        for name, speedup in (("best", best), ("accurate", accurate)):
            if speedup is not None:
                DeviceSpeedup.objects.create(
                    device=device, front=front, configuration=configurations[name],
                    baseline=configurations["default"], backend="opencl", processor="Mali-G78", algorithm=2,
                    speedup=speedup, sessions=sessions, installations=1, state="valid",
                    last_session_at=datetime(2026, 11, 20, tzinfo=UTC), witnesses=3,
                )  # fmt: skip
    revision.bump()


def test_the_winner_of_each_device_and_what_the_references_best_costs_there(
    measured: None, django_assert_max_num_queries: Any
) -> None:
    with django_assert_max_num_queries(9):
        winners = selectors.winners(SpeedupFilters())

    assert [
        (row.device.slug, row.winner, row.reference_rank, row.configurations) for row in winners.rows
    ] == [
        ("a", "best", 1, 3),
        ("b", "accurate", 2, 3),
        ("c", "default", 3, 3),
    ]
    assert [row.regret for row in winners.rows] == [1.0, pytest.approx(1.25), pytest.approx(1.25)]
    assert winners.counts == (("accurate", 1), ("best", 1), ("default", 1))
    assert (winners.judged, winners.median_regret) == (3, pytest.approx(1.25))
    assert (winners.wins, winners.nearly_wins) == (1, pytest.approx(1 / 3))


@pytest.mark.slow
def test_nothing_measured_has_no_winner(front: FrontVersion) -> None:
    winners = selectors.winners(SpeedupFilters())

    assert (winners.rows, winners.judged, winners.wins, winners.median_regret) == ((), 0, 0, None)
    assert correlations.correlation_matrix(SpeedupFilters()).devices == ()


def test_the_matrix_holds_the_devices_with_the_most_sessions(
    measured: None, django_assert_max_num_queries: Any
) -> None:
    selectors.winners(SpeedupFilters())
    with django_assert_max_num_queries(6):
        matrix = correlations.correlation_matrix(SpeedupFilters(), most=2)

    assert [device.slug for device in matrix.devices] == ["a", "b"]
    assert (matrix.sessions, matrix.left_out) == ((9, 3), 1)
    # Times relative to the default: (1/8, 2, 1) and (1/4, 1/5, 1).
    logs = np.log([[1 / 8, 2, 1], [1 / 4, 1 / 5, 1]])
    assert matrix.pearson[0, 1] == pytest.approx(np.corrcoef(logs)[0, 1])
    assert matrix.spearman[0, 1] == pytest.approx(-0.5)
    assert (matrix.common[0, 1], np.isnan(matrix.pearson[0, 0])) == (3, True)


def test_the_history_of_a_device_by_driver_and_version_of_the_system(
    front: FrontVersion, join: Join, django_assert_max_num_queries: Any
) -> None:
    old = device_document(os_version="15", opencl_driver="3.0 v1.r38p1")
    for best_us, device in ((20_000, old), (10_000, old), (5_000, device_document())):
        sent = session_document()
        sent["runs"] = [
            run_document(name, repeat, order, us + order)
            for name, repeat, order, us in (
                ("default", 0, 0, 80_000), ("best", 0, 1, best_us), ("best", 1, 2, best_us),
                ("default", 1, 3, 80_000),
            )
        ]  # fmt: skip
        join().submit(submission_document(sent, device=device))

    with django_assert_max_num_queries(6):
        history = selectors.history("google-pixel-8")

    assert history is not None
    assert (history.front, history.configuration, history.processor) == ("kfusion-test", "best", "Mali-G715")
    assert [(row.driver, row.os_version, row.sessions, row.installations) for row in history.releases] == [
        ("Mali r38p1", "15", 2, 2),
        ("Mali r44p1", "16", 1, 1),
    ]
    assert history.releases[0].speedup == pytest.approx(np.sqrt(32), rel=1e-3)
    assert history.releases[1].speedup == pytest.approx(16, rel=1e-3)
    assert selectors.history("none") is None
