"""Explorations by command: what a command line wishes, what is refused, and whole ones with their front."""

import json
import re
import shlex
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command, load_command_class
from django.test import Client

from crowd.audit.models import AuditEntry
from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.publishing.services import publish_content
from tests.builders.explorations import SPACE, measured_on, measurement, run_to_the_end

KFUSION = "pareto/spaces/kfusion.json"
FRONTS = Path("fixtures/fronts")
Evaluator = Callable[[Evaluation], Measurement]
_present: list[Evaluator] = []


def evaluate(evaluation: Evaluation, heartbeat: Any) -> Measurement:
    """What the commands measure with here."""
    return _present[0](evaluation)


@pytest.fixture
def measured_by(settings: Any, tiny_pack: Path) -> Callable[[Evaluator], None]:
    """Lets the commands measure over the tiny sequence with a function of the test."""
    settings.FRONTRUNNER_SEQUENCES = [tiny_pack.parent]
    settings.FRONTRUNNER_EVALUATOR = "tests.explorations.test_commands.evaluate"

    def use(evaluator: Evaluator) -> None:
        _present[:] = [evaluator]

    use(measured_on)
    return use


def explore(folder: Path, *more: str, sequence: str = "tiny") -> list[str]:
    (folder / "space.json").write_text(json.dumps(SPACE))
    return [
        *("explore", "--space", str(folder / "space.json"), "--sequence", sequence, "--budget", "3"),
        *("--points", "2", "--repeats", "2", "--method", "random", "--out", str(folder / "kfusion-7.json")),
        *more,
    ]


def start(*more: str) -> list[str]:
    return ["exploration", "start", "--space", KFUSION, "--sequence", "tiny", "--budget", "1", *more]


def test_explore_writes_a_front_that_can_be_published(
    db: None, measured_by: Any, tiny_pack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call_command(*explore(tmp_path, sequence=str(tiny_pack)))

    document = json.loads((tmp_path / "kfusion-7.json").read_text())
    names = [point["name"] for point in document["configurations"]]
    assert names[:2] == ["default", "best"]
    assert (document["application"], document["version"]) == ("kfusion", "7")
    predicted = {point["name"]: point["predicted"] for point in document["configurations"]}
    assert predicted["best"]["runtime"] < predicted["default"]["runtime"]
    assert predicted["best"]["ate_max"] < 0.05
    assert {point["measurements"] for point in predicted.values()} == {2}
    provenance = document["provenance"]
    searched = Evaluation.objects.filter(exploration__prepares=None)
    assert provenance["evaluations"] == searched.count() > 5 + 3
    assert provenance["sequence_sha256"] == document["sequence"]["sha256"]
    assert all(provenance[name] for name in ("device", "driver", "date", "software", "protocol", "command"))
    assert document["protocol"]["version"] == 2
    assert all(point["band"] and point["trajectory"] for point in document["configurations"])
    assert len(capsys.readouterr().out.splitlines()) == Evaluation.objects.count() + 1
    front, new = publish_content(json.loads((tmp_path / "kfusion-7.json").read_text()))
    assert (front.slug, new) == ("kfusion-7", True)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--out", "front.json"], "<application>-<version>.json"),
        (["--out", "nowhere/kfusion-1.json"], "there is no folder"),
        (["--space", "none.json"], "none.json"),
        (["--sequence", "none"], "none"),
        (["--budget", "0"], "greater than or equal to 1"),
        (["--repeats", "1"], "give 2 or more to publish a front"),
    ],
)
def test_a_wrong_argument_of_explore_is_one_line(
    db: None, measured_by: Any, tmp_path: Path, more: list[str], message: str
) -> None:
    with pytest.raises(CommandError, match=message) as refused:
        call_command(*explore(tmp_path, *more))

    assert "\n" not in str(refused.value)
    assert not Exploration.objects.exists()


def test_an_exploration_that_is_paused_meanwhile_has_no_front_yet(
    db: None, measured_by: Any, tmp_path: Path
) -> None:
    def measure_and_pause(evaluation: Evaluation) -> Measurement:
        services.pause(Exploration.objects.get())
        return measurement(evaluation.configuration)

    measured_by(measure_and_pause)
    with pytest.raises(CommandError, match="is paused: no front was written"):
        call_command(*explore(tmp_path))
    assert not (tmp_path / "kfusion-7.json").exists()
    measured_by(measured_on)

    call_command(*explore(tmp_path))

    assert {row.state for row in Exploration.objects.all()} == {"done"}
    assert (tmp_path / "kfusion-7.json").exists()


def test_a_machine_that_cannot_measure_ends_the_command_with_the_reason(
    db: None, measured_by: Any, tmp_path: Path
) -> None:
    def lacking(evaluation: Evaluation) -> Measurement:
        raise CannotMeasureHereError("no OpenCL device matches 'abacus'")

    measured_by(lacking)
    with pytest.raises(CommandError, match="abacus"):
        call_command(*explore(tmp_path))

    assert not Evaluation.objects.exclude(state="pending").exists()


def test_what_another_worker_measures_is_waited_for_and_is_no_failure(
    db: None, measured_by: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ReferenceDevice.objects.create(name="this-machine", queue="this-machine", machines=2)
    others: list[Evaluation] = []

    def beside_another(evaluation: Evaluation) -> Measurement:
        searching = evaluation.exploration.prepares_id is None
        if searching and evaluation.number == 0:
            taken = leases.take(services.pending_evaluations(evaluation.exploration)[0].pk, "another")
            assert taken is not None
            others.append(taken)
        if searching and evaluation.number == 4:
            assert leases.record(others[0], measurement(others[0].configuration))
        return measured_on(evaluation)

    measured_by(beside_another)
    call_command(*explore(tmp_path))

    output = capsys.readouterr().out
    assert "failed" not in output
    assert len(output.splitlines()) == Evaluation.objects.count() + 1
    assert Evaluation.objects.get(worker="another").attempt == 1


@pytest.mark.slow
def test_the_command_that_the_page_shows_can_be_given(db: None, client: Client) -> None:
    page = client.get("/explorations/").content.decode()
    shown = re.search(r"<code>(.*?)</code>", page, flags=re.DOTALL)
    assert shown is not None
    program, script, name, *words = shlex.split(unescape(shown[1]).replace("\\\n", " "))

    parser = load_command_class("crowd.explorations", name).create_parser(script, name)
    options = vars(parser.parse_args(words))

    assert (program, script) == (".venv/bin/python", "manage.py")
    assert (options["act"], str(options["space"]), options["wait"]) == ("start", KFUSION, True)


def test_a_search_without_limits_is_asked_for_in_words(
    unsaved: Exploration, unread_queues: None, capsys: pytest.CaptureFixture[str]
) -> None:
    call_command(*start("--device", "bench", "--no-limits", "--objectives", "runtime,cpu_seconds"))

    created = Exploration.objects.get()
    assert (created.limits, created.objectives) == ({}, ["runtime", "cpu_seconds"])
    with pytest.raises(CommandError, match=r"lack ate_max.*--no-limits"):
        call_command(*start("--device", "bench", "--objectives", "runtime,cpu_seconds"))


def test_known_configurations_are_measured_before_the_search(
    db: None, unread_queues: None, measured_by: Any, tmp_path: Path
) -> None:
    (shipped,) = FRONTS.glob("kfusion-*.json")
    points = json.loads(shipped.read_text())["configurations"]
    ReferenceDevice.objects.create(name="bench", queue="bench")
    (tmp_path / "two.json").write_text(json.dumps([points[1]["parameters"], points[0]["parameters"]]))
    (tmp_path / "other.json").write_text(json.dumps({"name": "kfusion"}))
    (tmp_path / "wrong.json").write_text(json.dumps([{"mu": "thin"}]))

    call_command(*start("--device", "bench", "--known", str(shipped)))
    call_command(*start("--device", "bench", "--known", str(tmp_path / "two.json")))
    with pytest.raises(CommandError, match=r"a known configuration cannot run: .*thin"):
        call_command(*start("--device", "bench", "--known", str(tmp_path / "wrong.json")))
    with pytest.raises(CommandError, match=r"other\.json is neither a front file nor a list"):
        call_command(*start("--device", "bench", "--known", str(tmp_path / "other.json")))

    newer, older = Exploration.objects.order_by("-pk")
    for exploration, count in ((older, len(points) - 1), (newer, 1)):  # the default is known anyway
        known = exploration.evaluations.filter(phase="given", label="")
        assert known.count() == count
        assert known.first().configuration == points[1]["parameters"]


def test_the_opencl_device_stays_while_an_exploration_counts_on_it(
    unsaved: Exploration, unread_queues: None
) -> None:
    call_command(*start("--device", "bench", "--opencl", "pthread"))
    call_command(*start("--device", "bench", "--opencl", "pthread"))

    with pytest.raises(
        CommandError,
        match=r"bench measures exploration \d+ on opencl, pthread.*cannot change to opencl, mali",
    ):
        call_command(*start("--device", "bench", "--opencl", "mali"))

    assert ReferenceDevice.objects.get().opencl_device == "pthread"
    assert Exploration.objects.count() == 2
    Exploration.objects.update(state="cancelled")
    call_command(*start("--device", "bench", "--opencl", "mali"))
    assert ReferenceDevice.objects.get().opencl_device == "mali"


def test_a_wish_that_is_refused_leaves_the_device_as_it_was(unsaved: Exploration) -> None:
    with pytest.raises(CommandError, match="greater than or equal to 1"):
        call_command(*start("--device", "bench", "--opencl", "mali", "--batch", "0"))

    assert ReferenceDevice.objects.get().opencl_device == ""


def test_a_budget_beyond_all_measure_is_refused(exploration: Exploration) -> None:
    for budget in ("99999999999999999999", "1000001", "6", "many"):
        with pytest.raises(CommandError, match="whole number above 6, 1000000 at most"):
            call_command("exploration", "raise-budget", str(exploration.pk), budget)


def test_a_front_is_exported_of_points_that_were_measured_again(
    exploration: Exploration, tmp_path: Path
) -> None:
    path = tmp_path / "kfusion-2.json"
    exploration.repeats = 1
    exploration.save()
    run_to_the_end(exploration)
    with pytest.raises(CommandError, match="no configuration was repeated 2 times"):
        call_command("exploration", "export", str(exploration.pk), "--front", str(path))
    assert not path.exists()

    again = [(row.configuration, row.label) for row in exploration.evaluations.filter(phase="repeat")]
    services.measure_again(exploration, again, 1)
    run_to_the_end(exploration)
    call_command("exploration", "export", str(exploration.pk), "--front", str(path))

    assert json.loads(path.read_text())["configurations"]


def test_an_export_counts_what_it_holds(
    explored: Exploration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = ReferenceDevice.objects.create(name="board", queue="board")
    warm = services.create(services.clone(explored, reference_device=board, warm_start_from=explored))
    assert warm.evaluations.filter(phase="prior").exists()

    call_command("exploration", "export", str(warm.pk), "--out", str(tmp_path / "all.csv"))

    lines = (tmp_path / "all.csv").read_text().splitlines()
    assert f"{len(lines) - 1} evaluations" in capsys.readouterr().out


def test_steps_of_the_command_line_are_logged_too(exploration: Exploration, unread_queues: None) -> None:
    for arguments in (("pause",), ("resume",), ("raise-budget", "9"), ("retry",), ("cancel",)):
        name, *more = arguments
        call_command("exploration", name, str(exploration.pk), *more)

    rows = AuditEntry.objects.order_by("pk")
    assert {row.actor for row in rows} == {"command line"}
    assert [row.action for row in rows] == [
        *("paused", "resumed", "budget raised", "failures repeated", "cancelled")
    ]
