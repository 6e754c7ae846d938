"""A whole exploration as a file: what travels, what is refused, and what another server may do with it."""

import gzip
import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from django.core.exceptions import ValidationError
from django.core.management import CommandError, call_command
from django.test import Client
from django.urls import reverse

from crowd.audit.models import AuditEntry
from crowd.explorations import services, steering
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes import exploration_file, importing, publishing
from crowd.explorations.outcomes.exploration_file import InvalidExplorationError
from tests.builders.explorations import finish, record, run_to_the_end
from tests.shipped import FIXTURES

FAILURE = "/srv/frontrunner/slam/run.py is gone"
LEFT_HERE = {
    *("id", "exploration_id", "copied_from_id", "created_at", "worker", "heartbeat_at", "lease_until"),
    *("stop_above", "error"),
}


@pytest.fixture
def measured(several: Exploration) -> Exploration:
    """One that learned on three sequences, with a failure."""
    exploration = services.create(several)
    first, *others = services.pending_evaluations(exploration)
    finish([first])
    record(others[0], FAILURE, worker="host-7:4711")
    return run_to_the_end(exploration)


@pytest.fixture
def elsewhere(measured: Exploration) -> Exploration:
    """The same as another server imports it, which has no such exploration."""
    whole = exploration_file.document(measured, "far-away")
    measured.delete()
    return importing.store(whole, "anna")


def columns(exploration: Exploration) -> list[dict[str, Any]]:
    return [
        {name: value for name, value in row.items() if name not in LEFT_HERE}
        for row in exploration.evaluations.order_by("number").values()
    ]


def changed(exploration: Exploration, change: Callable[..., object]) -> bytes:
    """The file of `exploration` after `change` of its JSON, with the digest of the changed content."""
    document = json.loads(gzip.decompress(exploration_file.pack(exploration_file.document(exploration))))
    change(document)
    content = {name: document[name] for name in ("evaluations", "exploration")}
    text = msgspec.json.encode(content, order="sorted")
    document.setdefault("sha256", hashlib.sha256(text).hexdigest())
    return gzip.compress(json.dumps(document).encode())


def test_rows_and_settings_are_the_same_after_an_import(measured: Exploration) -> None:
    whole, before = exploration_file.document(measured, "far-away"), columns(measured)
    ignored = {"id", "reference_device_id", "sha256"}
    settings = {name: value for name, value in Exploration.objects.values()[0].items() if name not in ignored}
    measured.delete()

    imported = importing.store(exploration_file.parse(exploration_file.pack(whole)), "anna")

    assert columns(imported) == before
    assert Exploration.objects.values()[0] == settings | Exploration.objects.values(*ignored)[0]
    assert imported.evaluations.get(state="failed").error == "run.py is gone"
    again = exploration_file.document(imported)
    assert exploration_file.pack(again) == exploration_file.pack(whole)
    entry = AuditEntry.objects.get(action="imported")
    assert (entry.actor, entry.digest) == ("anna", whole.sha256)


def test_neither_hosts_nor_folders_travel(measured: Exploration) -> None:
    measured.command = "python manage.py explore --out /srv/fronts/kfusion-7.json"
    text = gzip.decompress(exploration_file.pack(exploration_file.document(measured, "far-away"))).decode()

    assert "host-7" not in text
    assert "/srv" not in text


def test_the_digest_changes_with_the_rows_and_not_with_the_machine(measured: Exploration) -> None:
    first = exploration_file.document(measured, "one")
    measured.reference_device.name = "renamed"
    same = exploration_file.document(measured, "other")

    finish(services.measure_again(measured, [(measured.evaluations.all()[0].configuration, "")], 1))

    assert same.sha256 == first.sha256
    assert exploration_file.document(measured).sha256 != first.sha256


def test_the_same_exploration_is_imported_once(elsewhere: Exploration) -> None:
    whole = exploration_file.document(elsewhere)

    with pytest.raises(importing.KnownExplorationError, match=f"kfusion {elsewhere.pk} is this exploration"):
        importing.store(whole, "anna")

    assert Exploration.objects.count() == 1


def test_the_exploration_that_ships_is_imported_once(db: None) -> None:
    [shipped] = (FIXTURES / "explorations").glob("*.json.gz")
    imported = importing.import_file(shipped)

    with pytest.raises(importing.KnownExplorationError, match=f"kfusion {imported.pk} is this exploration"):
        importing.import_file(shipped)


def test_the_server_that_measured_it_refuses_its_own_file(measured: Exploration) -> None:
    with pytest.raises(importing.KnownExplorationError, match="is this exploration"):
        importing.store(exploration_file.document(measured), "anna")


Change = Callable[[dict[str, Any]], object]
WRONG: list[tuple[Change, str]] = [
    (lambda d: d.update(format="front"), "format: is 'front', not 'frontrunner-exploration': give"),
    (lambda d: d.update(version=2), "version: is 2, and this program reads 1: export it"),
    (lambda d: d["evaluations"][1].update(number=-1), r"evaluations\[1\].number: Expected `int` >= 0: corr"),
    (lambda d: d["evaluations"][1].update(number=0), r"evaluations\[1\].number: 0 does not follow 0"),
    (lambda d: d["evaluations"][1].update(color=0), r"evaluations\[1\]: .*unknown field `color`: corr"),
    (lambda d: d["evaluations"][0].pop("objectives"), r"evaluations\[0\].objectives: is missing, although"),
    (lambda d: d["evaluations"][0]["parts"][0].update(sequence="moon"), "'moon' is not a sequence of the"),
    (lambda d: d["evaluations"][0].update(phase="guessed"), r"evaluations\[0\].phase: .*guessed"),
    (lambda d: d["exploration"].update(method="luck"), r"exploration.method: .*luck.*Correct the expl"),
    (lambda d: d["exploration"]["space"].pop("parameters"), "exploration.space: .*parameters"),
    (lambda d: d["exploration"].update(prepares="kfusion-9"), "exploration.prepares: there is no front"),
    (lambda d: d.update(evaluations=[]), "evaluations: Expected `array` of length >= 1"),
]


@pytest.mark.slow
def test_a_wrong_member_is_named_with_the_remedy(measured: Exploration, subtests: pytest.Subtests) -> None:
    without_digest = {
        reason: changed(measured, lambda d, change=change: (d.pop("sha256"), change(d)))
        for change, reason in WRONG
    }
    measured.delete()

    for reason, content in without_digest.items():
        with subtests.test(reason), pytest.raises(InvalidExplorationError, match=reason):
            importing.store(exploration_file.parse(content), "anna")
    assert not Exploration.objects.exists()


def test_a_file_that_was_changed_by_hand_is_refused(measured: Exploration) -> None:
    content = changed(measured, lambda d: d["evaluations"][0]["objectives"].update(runtime=1e-6))

    with pytest.raises(
        InvalidExplorationError, match=r"sha256: the content has the digest .* export it again"
    ):
        exploration_file.parse(content)


def test_a_damaged_file_is_refused(measured: Exploration) -> None:
    content = exploration_file.pack(exploration_file.document(measured))

    for wrong, reason in ((content[:-20], "cut off"), (b"{}", "cannot be unpacked"), (b"", "cut off")):
        with pytest.raises(InvalidExplorationError, match=reason):
            exploration_file.parse(wrong)


def test_a_bomb_is_not_unpacked(measured: Exploration, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploration_file, "LARGEST_FILE_BYTES", 1000)

    with pytest.raises(InvalidExplorationError, match="at most 1000 bytes"):
        exploration_file.parse(gzip.compress(b" " * 2000))


def test_an_unfinished_exploration_travels_with_what_is_finished(exploration: Exploration) -> None:
    with pytest.raises(InvalidExplorationError, match="no finished evaluation yet"):
        exploration_file.document(exploration)
    finish(services.pending_evaluations(exploration)[:1])

    whole = exploration_file.document(exploration)

    assert (len(whole.evaluations), whole.state) == (1, "cancelled")


def test_what_was_measured_elsewhere_never_continues_here(elsewhere: Exploration) -> None:
    for name in steering.STEPS:
        with pytest.raises(ValidationError, match="was measured elsewhere, on far-away, and cannot continue"):
            steering.take_step(name, elsewhere, "anna", "500")
    with pytest.raises(ValidationError, match="start a new exploration from it"):
        steering.measure_again(
            elsewhere, [row.configuration_key for row in elsewhere.evaluations.all()], 1, "a"
        )

    assert steering.available_steps(elsewhere) == []
    assert services.advance(elsewhere.pk) == []
    assert not Evaluation.objects.filter(state="pending").exists()


def test_a_new_exploration_starts_from_what_was_measured_elsewhere(elsewhere: Exploration) -> None:
    here = ReferenceDevice.objects.get(elsewhere="")

    started = services.create(
        services.clone(elsewhere, reference_device=here, warm_start_from=elsewhere, method="random")
    )

    priors = started.evaluations.filter(phase="prior").count()
    assert priors > 0
    assert started.evaluations.filter(state="pending").exists()
    with pytest.raises(ValidationError, match="reference device"):
        services.validate(services.clone(elsewhere))


def test_pages_and_the_api_say_that_it_was_measured_elsewhere(
    administrator: Client, elsewhere: Exploration
) -> None:
    client = administrator
    page = re.sub(r"\s+", " ", client.get(f"/explorations/{elsewhere.pk}/").content.decode())
    administration = client.get(reverse("admin:explorations_exploration_change", args=[elsewhere.pk]))
    points = client.get(reverse("admin:explorations_exploration_points", args=[elsewhere.pk]))
    summary = client.get("/api/v1/explorations").json()["results"][0]

    assert "On Bench CPU, over" in page
    assert "Measured elsewhere:</strong> by &ldquo;far-away&rdquo;. This server has the measurements" in page
    assert "measured elsewhere, by &ldquo;far-away&rdquo;" in client.get("/explorations/").content.decode()
    assert "measured elsewhere</strong>, by the machine far-away" in administration.content.decode()
    assert 'name="step"' not in administration.content.decode()
    assert "Measure the named points again" not in points.content.decode()
    assert (
        "measured elsewhere, on far-away" in client.get("/admin/explorations/exploration/").content.decode()
    )
    assert summary["measured_elsewhere"] == {"machine": "far-away", "device": "Bench CPU"}
    form = client.get(f"/admin/explorations/exploration/add/?warm_start={elsewhere.pk}").content.decode()
    assert "far-away)</option>" not in form.split('name="reference_device"')[1].split("</select>")[0]
    assert client.get(f"/api/v1/explorations/{elsewhere.pk}").json()["measured_elsewhere"] is not None


def test_a_device_of_another_server_gets_no_token(administrator: Client, elsewhere: Exploration) -> None:
    key = elsewhere.reference_device_id
    page = reverse("admin:explorations_referencedevice_token", args=[key])

    answer = administrator.post(page, {"act": "issue"})

    assert answer.status_code == 403
    assert ReferenceDevice.objects.get(pk=key).token_sha256 is None


def test_a_front_names_the_digest_of_its_exploration(explored: Exploration) -> None:
    found, _ = publishing.candidates(explored)

    front = publishing.create_draft(explored, {row.key: row.name for row in found if row.name}, "anna")

    digest = exploration_file.document(explored).sha256
    assert front.content.provenance["exploration"] == {"sha256": digest}
    assert Exploration.objects.get().sha256 == digest


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((FIXTURES / "fronts").glob("*.json")), ids=lambda path: path.stem)
def test_a_front_that_ships_brings_its_evaluations(db: None, path: Path) -> None:
    """Some are of an earlier search, over other sequences."""
    front = json.loads(path.read_text())

    exploration = importing.import_file(FIXTURES / "explorations" / f"{path.stem}.json.gz", by="start")

    assert exploration.sha256 == front["provenance"]["exploration"]["sha256"]
    assert exploration.evaluations.count() >= front["provenance"]["evaluations"]


def test_export_and_import_by_command(
    measured: Exploration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, number = tmp_path / "kfusion-7.json.gz", measured.evaluations.count()
    call_command("exploration", "export", str(measured.pk), "--out", str(file), "--machine", "far-away")
    measured.delete()

    call_command("exploration", "import", str(file))

    said = capsys.readouterr().out
    assert f"{number} evaluations, {file.stat().st_size} bytes, digest" in said
    assert re.search(rf"imported as kfusion \d+: {number} evaluations, measured on far-away", said)
    with pytest.raises(CommandError, match="is this exploration"):
        call_command("exploration", "import", str(file))
    with pytest.raises(CommandError, match=r"absent\.json\.gz cannot be read"):
        call_command("exploration", "import", str(tmp_path / "absent.json.gz"))
    call_command("exploration", "status")
    assert "elsewhere, on far-away" in capsys.readouterr().out
