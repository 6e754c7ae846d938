"""`manage.py front`: what it shows before it publishes, and which files it refuses."""

import io
import json
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from crowd.audit.models import AuditEntry
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services
from crowd.operations import first_run
from tests.builders.documents import front_document, predict


@pytest.mark.slow
def test_the_command_line_publishes_only_what_ships_where_two_people_are_needed(
    draft: FrontVersion, pack: dict[str, Any], settings: Any, tmp_path: Path
) -> None:
    settings.FRONTRUNNER_SECOND_PERSON, settings.FRONTRUNNER_FRONTS = True, tmp_path
    (tmp_path / "broken.json").write_text("{}")
    services.submit(draft, by="anna")

    with pytest.raises(CommandError, match="the command line does not say who you are"):
        call_command("front", "publish", "kfusion-1", "--yes")

    shipped = tmp_path / "kfusion-2.json"
    shipped.write_text(json.dumps(front_document(pack, version="2")))
    assert "kfusion-2 ships with" in list(first_run.publish_shipped_fronts())[1]
    call_command("front", "publish", "kfusion-2", "--yes")
    states = FrontVersion.objects.order_by("slug").values_list("slug", "state")
    assert list(states) == [("kfusion-1", "in-review"), ("kfusion-2", "published")]


class Terminal(io.StringIO):
    """A person at a terminal who types these lines."""

    def isatty(self) -> bool:
        return True


def test_the_command_shows_what_changes_and_asks(
    draft: FrontVersion,
    pack: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    services.publish(services.submit(draft))
    worse = front_document(pack, version="2")
    predict(worse["configurations"][1], runtime=0.02, ate_max=None)
    del worse["configurations"][2]
    path = tmp_path / "kfusion-2.json"
    path.write_text(json.dumps(worse))

    monkeypatch.setattr("sys.stdin", Terminal("n\n"))
    call_command("front", "publish", str(path))

    assert capsys.readouterr().out.splitlines() == [
        "Clients measure kfusion-2 instead of kfusion-1.",
        "Phones and other browsers cannot measure it: only the native client can.",
        "  lost: accurate",
        "  changed: best, runtime 0.01 -> 0.02 s, largest error 0.04 -> None m",
        "  hypervolume: 0.000 times the earlier one",
        "WARNING: The predicted speedup over default of best gets worse: "
        "4.00x instead of 8.00x in kfusion-1.",
        "WARNING: The predicted largest error of best is unknown in kfusion-2: it cannot be compared.",
        "Publish kfusion-2? [y/N] kfusion-2: not published",
    ]
    assert not FrontVersion.objects.filter(slug="kfusion-2").exists()

    monkeypatch.setattr("sys.stdin", Terminal("y\n"))
    call_command("front", "publish", str(path))
    assert FrontVersion.objects.get(slug="kfusion-2").state == "published"


def test_without_a_terminal_the_command_needs_a_yes(
    draft: FrontVersion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))

    with pytest.raises(CommandError, match="kfusion-1: cannot ask without a terminal: add --yes"):
        call_command("front", "publish", "kfusion-1")

    assert FrontVersion.objects.get().state == "draft"


def test_an_exported_front_imports_as_the_same_content(
    draft: FrontVersion, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "front.json"
    digest = draft.digest
    call_command("front", "export", "kfusion-1", out=path)
    services.discard(draft)

    call_command("front", "import", str(path))
    call_command("front", "publish", "kfusion-1", "--yes")
    call_command("front", "retire", "kfusion-1")

    assert capsys.readouterr().out.splitlines() == [
        f"kfusion-1: {path}",
        "kfusion-1: imported as a draft; publish it with: frontrunner admin front publish kfusion-1",
        "No front of kfusion is published now: kfusion-1 is the first.",
        "Phones and other browsers cannot measure it: only the native client can.",
        "kfusion-1: published",
        "kfusion-1: retired",
    ]
    assert FrontVersion.objects.get().digest == digest
    assert "[0.01, 0.5, 0.1],\n" in path.read_text()  # a position is one line
    assert {row.actor for row in AuditEntry.objects.exclude(actor="anna")} == {"command line"}


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("protocol.frames", None, "protocol.frames: is missing, add it"),
        ("protocol.frames", "many", "protocol.frames: Expected `int`, got `str`"),
        ("version", "Version 1", "version: must be lower-case letters, digits, dots"),
        ("sequence.sha256", "0", "sequence.sha256: must be a sha256 of 64 hexadecimal digits"),
        ("configurations.1.predicted.runtime", -1, "configurations[1].predicted.runtime"),
        ("configurations.1.predicted.ate_max", float("inf"), "ate_max: must be a finite number"),
        (
            "configurations.1.parameters.mu",
            -1.0,
            "configurations[1].parameters of best: mu=-1.0: must be above 0",
        ),
        ("configurations.1.parameters.nu", 1, "unknown parameter nu"),
        ("protocol.order", ["default", "worst"], "protocol.order"),
        ("provenance", None, "provenance: is missing, add it"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_the_member(
    db: None, pack: dict[str, Any], tmp_path: Path, path: str, value: Any, complaint: str
) -> None:
    document = json.loads(json.dumps(front_document(pack)))
    *parents, member = path.split(".")
    place = document
    for name in parents:
        place = place[int(name)] if name.isdigit() else place[name]
    if value is None:
        del place[member]
    else:
        place[member] = value
    file = tmp_path / "front.json"
    file.write_text(json.dumps(document))

    with pytest.raises(CommandError) as refused:
        call_command("front", "import", str(file))

    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not FrontVersion.objects.exists()


@pytest.mark.parametrize("content", [b"[]", b"\xff\xfe", b"", b"7"])
def test_a_file_that_holds_no_object_is_refused(db: None, tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "front.json"
    file.write_bytes(content)

    with pytest.raises(CommandError, match=r"front\.json"):
        call_command("front", "publish", str(file))


def test_a_version_that_is_not_there_is_named_with_those_that_are(draft: FrontVersion) -> None:
    with pytest.raises(CommandError, match=r"no front kfusion-9: choose from kfusion-1"):
        call_command("front", "publish", "kfusion-9")
