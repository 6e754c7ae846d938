"""What exports, API, report, pages, commands and the administration show of several sequences."""

import csv
import json
import shlex
from typing import Any

import pytest
from django.core.management import CommandError, call_command
from django.test import Client
from django.urls import reverse

from crowd.api_pages.openapi import document as openapi
from crowd.explorations import forms, services
from crowd.explorations.management.measuring_here import _outcome
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import creation_command, exports
from crowd.explorations.outcomes.report import markdown
from tests.builders.explorations import finish, run_to_the_end
from tests.dashboard.reading import read
from tests.explorations.outcomes.test_report import rows
from tests.explorations.test_administration import ADD, wish
from tests.explorations.test_several_sequences import BAD, random_row

KFUSION = "pareto/spaces/kfusion.json"


@pytest.fixture
def done(several: Exploration) -> Exploration:
    """A finished one, with a measurement that ended early."""
    exploration = services.create(several)
    random_row(exploration, BAD)
    return run_to_the_end(exploration)


def test_a_table_has_a_column_for_each_sequence(done: Exploration) -> None:
    table = list(csv.DictReader("".join(exports.csv_lines(done)).splitlines()))
    objects = json.loads("".join(exports.json_lines(done)))

    early = next(row for row in table if "ate_max" in row["censored"].split(","))
    again = next(row for row in objects if row["phase"] == "repeat" and row["perturbation"] == 1)
    assert float(early["ate_max@tiny"]) == float(early["ate_max"])
    assert (early["ate_max@desk"], early["lost@desk"], early["lost@tiny"]) == ("", "", "0")
    assert again["ate_max@library"] == pytest.approx(2 * again["ate_max@attic"])
    assert {"runtime@library", "lost@library"} <= set(again)
    assert {name for name in again if "@" in name} == {name for name in table[0] if "@" in name}


def test_a_table_of_one_sequence_has_none(exploration: Exploration) -> None:
    finish(services.pending_evaluations(exploration))

    line = next(iter(exports.csv_lines(exploration)))

    assert "@" not in line
    assert "ate_max_ratio" in line


def test_the_api_tells_of_the_sequences_and_of_each_part(client: Client, done: Exploration) -> None:
    answer = client.get(f"/api/v1/explorations/{done.pk}?limit=1000").json()

    assert [pack["name"] for pack in answer["sequences"]] == ["tiny", "desk", "attic"]
    assert answer["held_out"] == done.held_out_sequences
    assert (answer["sequence"], answer["error_quantile"]) == ("tiny", 1.0)
    early = next(row for row in answer["measurements"] if row["censored"])
    assert [part["sequence"] for part in early["parts"]] == ["tiny"]
    assert early["parts"][0]["lost"] == 0
    assert early["parts"][0]["objectives"]["ate_max"] == early["objectives"]["ate_max"]
    assert {row["perturbation"] for row in answer["measurements"]} == {0, 1}


def test_a_report_has_the_largest_error_on_each_sequence(done: Exploration) -> None:
    text = markdown(done)

    assert "Learned on tiny, desk, attic: an error is the worst of these" in text
    assert "Held out, not used by the search: library." in text
    table = [line for line in rows(text) if len(line) > 10]
    assert table[0][3:9] == [
        *("max ATE, cm", "on tiny, cm", "on desk, cm", "on attic, cm", "held out: library, cm", "measured")
    ]
    default = next(line for line in table if line[0] == "default")
    assert float(default[3]) == float(default[6]) == pytest.approx(4 * float(default[4]), abs=0.05)
    assert float(default[7]) == pytest.approx(8 * float(default[4]), abs=0.05)


def test_pages_say_what_is_learned_on_and_what_is_only_a_bound(client: Client, done: Exploration) -> None:
    page, listed = read(client, f"/explorations/{done.pk}/"), read(client, "/explorations/")

    assert "over tiny, desk, attic." in page
    assert "Its error is the worst of these." in page
    assert "Held out: library. The search never sees this sequence." in page
    early = Evaluation.objects.get(configuration=BAD, phase="random")
    assert early.objectives is not None
    assert f"at least {100 * early.objectives['ate_max']:.2f}" in page
    assert "tiny, desk, attic held out: library" in listed
    figure = client.get(f"/figures/explorations/{done.pk}.json").json()
    assert "at least" in json.dumps(figure["data"])


def test_a_page_of_one_sequence_says_nothing_of_several(client: Client, exploration: Exploration) -> None:
    page = read(client, f"/explorations/{exploration.pk}/")

    assert "over tiny." in page
    assert "worst of these" not in page
    assert "Held out" not in page


def test_a_line_of_the_command_says_at_least(done: Exploration) -> None:
    early, whole = done.evaluations.exclude(censored=[]).first(), done.evaluations.filter(censored=[]).first()
    assert early is not None
    assert whole is not None

    assert ">=" in _outcome(early)
    assert ">=" not in _outcome(whole)


def test_lists_of_the_administration_say_at_least(administrator: Client, done: Exploration) -> None:
    page = administrator.get(reverse("admin:explorations_evaluation_changelist")).content.decode()
    assert "at least 7" in page
    shown = administrator.get(reverse("admin:explorations_exploration_change", args=[done.pk]))
    assert "library" in shown.content.decode()


def test_the_form_creates_and_clones_several_sequences(
    administrator: Client, several: Exploration, unread_queues: None
) -> None:
    several.error_quantile = 0.5
    page = administrator.get(reverse(ADD)).content.decode()
    assert page.count("desk: 12 frames") == 3

    answer = administrator.post(reverse(ADD), wish(several))

    assert answer.status_code == 302, answer.context["errors"]
    created = Exploration.objects.get()
    assert {pack["name"] for pack in created.further_sequences} == {"desk", "attic"}
    assert created.held_out_sequences == several.held_out_sequences
    assert created.error_quantile == 0.5
    again = administrator.get(f"{reverse(ADD)}?clone={created.pk}").content.decode()
    assert again.count("checked") >= 3 + len(created.objectives)


def test_the_form_keeps_a_limit_on_the_ratio(administrator: Client, unsaved: Exploration) -> None:
    unsaved.objectives, unsaved.limits = ["ate_max", "runtime_ratio"], {"runtime_ratio": 0.5}
    created = services.create(unsaved)

    page = administrator.get(f"{reverse(ADD)}?clone={created.pk}").content.decode()

    assert 'name="max_runtime_ratio" value="0.5"' in page


def test_the_form_refuses_a_sequence_that_is_named_twice(administrator: Client, several: Exploration) -> None:
    twice = wish(several, held_out_packs=forms.initial_values(several)["further_packs"])
    page = administrator.post(reverse(ADD), twice).content.decode()

    assert "is named twice" in page
    assert not Exploration.objects.exists()


def test_the_command_takes_several_sequences_and_is_reconstructed(
    several: Exploration, unread_queues: None
) -> None:
    names = ("--sequence", "tiny", "--sequence", "desk", "--held-out", "library", "--held-out", "attic")
    start = ("exploration", "start", "--space", KFUSION, "--budget", "1", "--device", "bench")
    call_command(*start, *names, "--quantile", "0.5")

    created = Exploration.objects.get()
    assert [pack["name"] for pack in created.learned_on] == ["tiny", "desk"]
    assert [pack["name"] for pack in created.held_out_sequences] == ["library", "attic"]
    assert created.failures_allowed == 1
    words = shlex.split(creation_command.creation_command(created))[2:]
    call_command(*words)
    again = Exploration.objects.latest("pk")
    for name in ("learned_on", "held_out_sequences", "error_quantile", "limits", "objectives"):
        assert getattr(again, name) == getattr(created, name)
    with pytest.raises(CommandError, match="no pack cellar in the sequence folders"):
        call_command(*start, *names, "--held-out", "cellar")
    with pytest.raises(CommandError, match="desk is named twice"):
        call_command(*start, *names, "--held-out", "desk")


def test_openapi_describes_parts() -> None:

    schemas: dict[str, Any] = openapi()["components"]["schemas"]
    assert {"parts", "censored", "perturbation"} <= set(schemas["EvaluationAnswer"]["properties"])
    assert {"sequences", "perturbation", "stop_above", "stop_after"} <= set(schemas["Lease"]["properties"])
    assert "parts" in schemas["Result"]["properties"]
