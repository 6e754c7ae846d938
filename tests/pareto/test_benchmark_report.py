"""When the comparison says that a target is met: beside another optimiser, with enough seeds behind both."""

import pytest

from tests.benchmarks.pareto_report import verdict


def row(name, *regrets):
    return {"name": name, "seeds": [*range(len(regrets))], "regret": {"limits": {200: list(regrets)}}}


@pytest.mark.parametrize(
    ("ours", "others", "said"),
    [
        ([0.04] * 5, [row("TPE", *[0.1] * 5)], "met"),
        ([0.06] * 5, [row("TPE", *[0.1] * 5)], "short"),
        ([0.04] * 5, [row("random", *[0.1] * 5)], "open: no other optimiser was run"),
        ([0.04] * 5, [{"name": "TPE", "failed": "not installed"}], "open: no other optimiser was run"),
        ([0.04] * 4, [row("TPE", *[0.1] * 5)], "open: bayesian has 4 of 5 seeds"),
        ([0.04] * 5, [row("TPE", *[0.1] * 5), row("GP", 0.09)], "open: GP has 1 of 5 seeds (met so far)"),
        ([0.04] * 5, [row("TPE", *[0.1] * 5), row("GP", 0.05)], "open: GP has 1 of 5 seeds (short so far)"),
        ([0.04] * 5, [row("TPE", *[0.1] * 5), row("GP", 0.2)], "met"),
        ([0.06] * 5, [row("TPE", *[0.1] * 5), row("GP", 0.05)], "short"),
    ],
)
def test_a_target_is_met_only_against_the_best_of_others_with_enough_seeds(ours, others, said):
    result = {"problem": "kfusion, limits", "rows": [row("bayesian", *ours), *others]}
    assert verdict(result, "limits", 200, "bayesian") == said


def test_a_ceiling_that_is_missed_is_missed_whatever_the_others_reach():
    result = {"problem": "BlackScholes", "rows": [row("bayesian", *[0.03] * 5), row("TPE", *[0.1] * 5)]}
    assert verdict(result, "limits", 200, "bayesian") == "short"
