"""Measurements in fresh processes, and whole explorations by command and by task."""

import json
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from crowd.explorations import measurement, services, tasks
from crowd.explorations.measurement import LeaseLostError, MeasurementError, read_report, run
from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts.models import FrontVersion
from crowd.fronts.services import publish_file
from tests.explorations.conftest import SPACE, finish

FAST = {"compute_size_ratio": 4, "volume_resolution": 32}


def test_a_measurement_tells_time_error_stages_and_device(tiny_pack: Path) -> None:
    result = run("kfusion", FAST, tiny_pack)

    assert 0 < result.objectives["runtime"] < 5
    assert 0 <= result.objectives["ate_mean"] <= result.objectives["ate_max"] < 1
    assert result.stages["computation"] == pytest.approx(result.objectives["runtime"])
    parts = [result.stages[stage] for stage in ("preprocessing", "tracking", "integration", "raycasting")]
    assert sum(parts) == pytest.approx(result.stages["computation"])
    assert result.device["name"]


@pytest.mark.parametrize(
    ("configuration", "device", "reason"),
    [
        ({"mu": -1.0}, "", "exit code 2: .*mu=-1.0"),
        ({"nonsense": 1}, "", "exit code 2: .*nonsense"),
        (FAST, "no such device", "exit code 2: .*no such device"),
    ],
)
def test_what_cannot_run_is_a_failure_with_its_reason(
    tiny_pack: Path, configuration: dict[str, Any], device: str, reason: str
) -> None:
    with pytest.raises(MeasurementError, match=reason):
        run("kfusion", configuration, tiny_pack, device)


def test_a_measurement_that_takes_too_long_is_ended(tiny_pack: Path) -> None:
    with pytest.raises(MeasurementError, match=r"no result after 0\.01 s"):
        run("kfusion", FAST, tiny_pack, timeout=0.01)


def test_a_measurement_whose_lease_is_lost_is_ended(tiny_pack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "HEARTBEAT_SECONDS", 0.01)
    with pytest.raises(LeaseLostError):
        run("kfusion", FAST, tiny_pack, heartbeat=lambda: False)


def test_a_process_that_aborts_is_named_by_its_signal() -> None:
    assert measurement._reason(-6, "pocl: out of memory\n") == "killed by SIGABRT: pocl: out of memory"
    assert measurement._reason(-11, "") == "killed by SIGSEGV: nothing on its error output"
    assert measurement._reason(1, "first\nlast") == "exit code 1: last"


def test_a_sequence_without_truth_teaches_nothing() -> None:
    with pytest.raises(MeasurementError, match="no true trajectory"):
        read_report({"ate": None})


def command(pack: Path, tmp_path: Path, *more: str) -> list[str]:
    (tmp_path / "space.json").write_text(json.dumps(SPACE))
    return [
        *("explore", "--space", str(tmp_path / "space.json"), "--sequence", str(pack)),
        *("--budget", "1", "--points", "2", "--repeats", "0", "--method", "random"),
        *("--out", str(tmp_path / "kfusion-7.json"), *more),
    ]


def test_the_command_writes_a_front_that_can_be_published(
    db: None, tiny_pack: Path, tmp_path: Path, settings: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    settings.FRONTRUNNER_SEQUENCES = [tiny_pack.parent]

    call_command(*command(tiny_pack, tmp_path))

    document = json.loads((tmp_path / "kfusion-7.json").read_text())
    names = [point["name"] for point in document["configurations"]]
    assert names[:2] == ["default", "best"]
    assert (document["application"], document["version"]) == ("kfusion", "7")
    predicted = {point["name"]: point["predicted"] for point in document["configurations"]}
    assert predicted["best"]["runtime"] < predicted["default"]["runtime"]
    assert predicted["best"]["ate_max"] < 0.05
    provenance = document["provenance"]
    assert provenance["evaluations"] == Evaluation.objects.count() == 5 + 1
    assert provenance["sequence_sha256"] == document["sequence"]["sha256"]
    assert all(provenance[name] for name in ("device", "driver", "date", "software", "protocol", "command"))
    assert len(capsys.readouterr().out.splitlines()) == Evaluation.objects.count() + 1
    front, new = publish_file(tmp_path / "kfusion-7.json")
    assert (front.slug, new) == ("kfusion-7", True)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--out", "front.json"], "<application>-<version>.json"),
        (["--out", "nowhere/kfusion-1.json"], "there is no folder"),
        (["--space", "none.json"], "none.json"),
        (["--sequence", "none"], "none"),
        (["--budget", "0"], "greater than or equal to 1"),
    ],
)
def test_a_wrong_argument_of_the_command_is_one_line(
    db: None, tiny_pack: Path, tmp_path: Path, settings: Any, more: list[str], message: str
) -> None:
    settings.FRONTRUNNER_SEQUENCES = [tiny_pack.parent]
    with pytest.raises(CommandError, match=message):
        call_command(*command(tiny_pack, tmp_path, *more))
    assert not Exploration.objects.exists()


def test_tasks_take_an_exploration_to_its_end(exploration: Exploration) -> None:
    exploration.budget, exploration.repeats = 1, 0
    exploration.save()
    finish(services.waiting(exploration)[1:])

    tasks.reap.delay()  # as a worker does when it starts; tasks run at once here

    exploration.refresh_from_db()
    assert exploration.state == "done"
    assert set(exploration.evaluations.values_list("state", flat=True)) == {"done"}
    assert exploration.evaluations.filter(phase="random").count() == 1


def test_a_task_for_a_finished_evaluation_does_nothing(exploration: Exploration) -> None:
    row = services.waiting(exploration)[0]
    Evaluation.objects.filter(pk=row.pk).update(state="failed", error="earlier")

    tasks.evaluate.delay(row.pk)

    row.refresh_from_db()
    assert (row.state, row.error, row.attempt) == ("failed", "earlier", 0)
    assert not FrontVersion.objects.exists()
