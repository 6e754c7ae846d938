"""Verdicts follow from what was measured, and the page says all of them."""

import re

import numpy as np
import pytest

from frontrunner.paper import report
from frontrunner.paper.budget import BUDGETS
from frontrunner.paper.exploration import explore, measure_references
from frontrunner.paper.findings import Results, Verdict, findings
from frontrunner.paper.page import write_html, write_markdown
from frontrunner.paper.response import Surface
from slam.reports.relief import Relief
from tests.docs import pages
from tests.docs.test_words import BANNED, LONGEST_IN_RESEARCH
from tests.frontrunner.paper.toy import Program, study

SURFACE = BUDGETS["small"].surface


def surface(times):
    """A grid with these (y, x) times in each of five rounds, with a little noise."""
    noise = 1 + 0.001 * np.random.default_rng(0).standard_normal((5, *times.shape))
    measured = {"runtime": times * noise, "ate_max": np.full((5, *times.shape), 0.01)}
    return Surface(SURFACE, measured, Relief.of(SURFACE.grid, measured["runtime"]))


def bowl():
    x, y = (np.arange(len(values), dtype=float) for values in (SURFACE.grid.x_values, SURFACE.grid.y_values))
    return 0.02 + 0.001 * (np.array(SURFACE.grid.x_values) - 0.2) ** 2 + 0.001 * (y[:, None] - 3) ** 2 + 0 * x


def ridge():
    return bowl() + 0.01 * (np.arange(10) == 4)


def searched(folder, **budget):
    one = study(**budget)
    return explore(one, folder / "search", Program()), measure_references(one, folder / "known", Program(), 1)


def verdicts(**results):
    return {item.figure: item.verdict for item in findings(Results(**results))}


def test_what_was_not_measured_is_said():
    found = verdicts()
    assert found["response surface of KinectFusion"] is Verdict.MISSING
    assert found["exploration of KinectFusion"] is Verdict.MISSING
    assert found["speedups of the crowd"] is Verdict.NOT_HERE


@pytest.mark.parametrize(("times", "verdict"), [(bowl(), Verdict.DIFFERENT), (ridge(), Verdict.REPRODUCED)])
def test_a_surface_is_reproduced_by_its_relief(times, verdict):
    assert verdicts(surface=surface(times))["response surface of KinectFusion"] is verdict


def test_the_inflection_is_not_answerable_with_few_samples_and_a_capped_search_proves_no_end(tmp_path):
    exploration, references = searched(tmp_path, batch=2, iterations=2)
    found = verdicts(kfusion=exploration, kfusion_references=references)
    assert found["random samples after which the front no longer improves"] is Verdict.TOO_FEW
    assert found["iterations of active learning"] is Verdict.TOO_FEW
    assert found["fitting the forests and predicting the whole space"] is Verdict.REPRODUCED


def test_a_search_to_its_end_answers_what_a_capped_one_does_not(tmp_path):
    exploration, references = searched(tmp_path, batch=None, iterations=None)
    found = verdicts(kfusion=exploration, kfusion_references=references)
    assert found["iterations of active learning"] is Verdict.REPRODUCED
    # Twelve random samples are fewer than the points of active learning here.
    assert found["valid configurations by phase"] is Verdict.DIFFERENT


def test_the_page_has_every_verdict_front_and_figure_in_plain_words(tmp_path):
    exploration, references = searched(tmp_path)
    results = Results(surface(ridge()), exploration, references, exploration, references)
    sections = list(report.sections(results, BUDGETS["small"], "small", "a <machine>"))
    write_markdown(tmp_path / "paper.md", report.TITLE, sections)
    write_html(tmp_path / "paper.html", report.TITLE, sections)

    text = (tmp_path / "paper.md").read_text()
    for finding in findings(results):
        assert f"| {finding.figure} | {finding.paper} | {finding.here} | {finding.verdict.value} |" in text
    assert "5 rounds: a single time varies by 0.1 %" in text
    assert "Algorithm 1 returns P" in text
    assert f"| default | {100 * references['default']['ate_max']:.2f} |" in text
    assert "| best speed" in text
    assert [line for line in pages.sentences(text) if len(line.split()) > LONGEST_IN_RESEARCH] == []
    assert not any(re.search(phrase, pages.prose(text)) for phrase in BANNED)
    page = (tmp_path / "paper.html").read_text()
    assert page.count("Plotly.newPlot(") == 2 + 2 * 3
    assert "a &lt;machine&gt;" in page
