"""Measurements in fresh processes, and whole explorations by command and by task."""

import json
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from crowd.explorations import services, tasks
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.models import FrontVersion
from crowd.fronts.services import publish_file
from tests.explorations.conftest import SPACE, finish


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
    # A queue in which no other test left a message.
    ReferenceDevice.objects.update(queue="unheard-of")
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
