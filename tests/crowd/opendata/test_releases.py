"""Releases stay at their addresses, share what did not change, and say what did."""

import hashlib
import json
from typing import Any

import pytest
from django.contrib.auth.models import User
from django.core.management import CommandError, call_command
from django.test import Client

from crowd.audit.models import AuditEntry
from crowd.results.models import Export, FileChange, StoredFile
from crowd.results.opendata import exports, releases
from tests.builders.crowds import Join
from tests.builders.documents import submission_document
from tests.builders.measuring import measure
from tests.builders.participant import API, Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import age, aged_export, all_files


def digest(client: Client, address: str) -> str:
    """SHA-256 of what `address` answers."""
    answer = client.get(address)
    assert answer.status_code == 200, answer.getvalue()
    return hashlib.sha256(answer.getvalue()).hexdigest()


@pytest.fixture
def released(participant: Participant) -> Export:
    """A release of one session, made earlier this month or the last, and older than any that is kept."""
    measure(participant)
    return aged_export()


def test_the_first_export_with_runs_of_a_month_is_a_release(client: Client, participant: Participant) -> None:
    empty = exports.create_export()
    age(1)
    participant.submit(submission_document())
    first = exports.create_export()
    age(1)
    second = exports.create_export()
    age(70)
    later = exports.create_export()

    assert [row.release for row in (empty, first, second, later)] == [False, True, False, True]
    listed = client.get(f"{API}/exports").json()["results"]
    assert [row["release"] for row in listed] == [True, False, True, False]


@IN_BOTH_PLACES
def test_a_release_answers_when_other_exports_are_gone(
    client: Client, released: Export, settings: Any
) -> None:
    settings.FRONTRUNNER_EXPORTS_KEPT = 2
    before = digest(client, f"/data/{released.name}/datapackage.json")
    for _ in range(4):
        exports.create_export()
        age(1)
    released.refresh_from_db()
    other = Export.objects.filter(release=False).last()
    assert other is not None

    assert digest(client, f"/data/{released.name}/datapackage.json") == before
    page = client.get(f"/data/{released.name}/")
    assert page.status_code == 200
    assert before in page.content.decode()
    for address in (f"/data/{other.name}/", f"/data/{other.name}/runs.parquet"):
        assert client.get(address).status_code == 410
    later = releases.releases().filter(started_at__gt=other.started_at).first()
    named = f"/data/{later.name}/" if later else "the next one will contain"
    assert named in client.get(f"/data/{other.name}/runs.parquet").json()["detail"]
    page = client.get(f"/data/{other.name}/").content.decode()
    assert (f'<a href="{named}">' if later else named) in page


def test_a_second_export_of_a_day_moves_only_latest(client: Client, participant: Participant) -> None:
    participant.submit(submission_document())
    first = exports.create_export()
    before = digest(client, f"/data/{first.name}/runs.parquet")
    participant.submit(submission_document())

    second = exports.create_export()

    assert digest(client, f"/data/{first.name}/runs.parquet") == before
    assert digest(client, "/data/latest/runs.parquet") != before
    location = client.get("/data/latest/runs.parquet").headers["Content-Location"]
    assert (second.name, location) == ("latest", "/data/latest/runs.parquet")
    listed = client.get(f"{API}/exports").json()["results"]
    assert [row["name"] for row in listed] == ["latest", first.name]
    assert all(client.get(file["url"]).status_code == 200 for row in listed for file in row["files"])
    exports.create_export()
    assert not Export.objects.filter(pk=second.pk).exists()


def test_exports_share_what_did_not_change(client: Client, participant: Participant, join: Join) -> None:
    participant.submit(submission_document())
    first, second = exports.create_export(), exports.create_export()

    shared = {file.name for file in first.files.all()} - {
        file.name for file in second.files.all() if file.stored.uses.count() == 1
    }

    # Each export gives installations other random names.
    assert {name.partition(".")[0] for name in shared} == {
        "runs", "run_states", "summaries", "figures", "devices", "configurations", "tombstones", "LICENCE",
        "recompute",
    }  # fmt: skip
    stored = set(StoredFile.objects.values_list("stored_as", flat=True))
    assert all_files() == stored


@IN_BOTH_PLACES
def test_an_erasure_rewrites_a_shared_part_once_and_says_why_its_digest_changed(
    client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = measure(participant)
    first = aged_export()
    second = exports.create_export()
    assert first.release
    assert second.release
    old = {
        name: digest(client, f"/data/{first.name}/{name}") for name in ("runs.parquet", "datapackage.json")
    }

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")
    exports.rewrite_all()

    runs = StoredFile.objects.get(table="runs", format="parquet")
    assert runs.changes.count() == 1
    for export in (first, second):
        page = client.get(f"/data/{export.name}/").content.decode()
        change = runs.changes.get()
        assert "something was erased" in page
        assert f">{change.old_sha256}</code>" in page
        assert f">{change.new_sha256}</code>" in page
        assert digest(client, f"/data/{export.name}/runs.parquet") == change.new_sha256
        package = client.get(f"/data/{export.name}/datapackage.json").getvalue()
        [resource] = [row for row in json.loads(package)["resources"] if row["path"] == "runs.parquet"]
        assert (resource["hash"], resource["rows"]) == (f"sha256:{change.new_sha256}", 3)
    page = client.get(f"/data/{first.name}/").content.decode()
    assert old["runs.parquet"] in page
    assert old["datapackage.json"] in page


def test_a_release_keeps_its_figures_when_something_else_is_erased(
    client: Client, participant: Participant, join: Join
) -> None:
    measure(participant, best_us=20_000)
    release = aged_export()
    before = digest(client, f"/data/{release.name}/figures.parquet")
    leaving = join()
    measure(leaving, best_us=5_000)
    exports.create_export()

    leaving.delete("/me")
    exports.rewrite_all()

    assert digest(client, f"/data/{release.name}/figures.parquet") == before
    changed = {change.stored.table for change in FileChange.objects.filter(stored__uses__export=release)}
    assert changed == {"tombstones", "datapackage", "sums"}


def test_an_administrator_makes_an_export_a_release(
    client: Client, released: Export, admin_client: Client
) -> None:
    today = exports.create_export()
    assert today.release  # of another month
    Export.objects.filter(pk=today.pk).update(release=False)

    answer = admin_client.post(
        "/admin/results/export/", {"action": "make_releases", "_selected_action": [today.pk]}, follow=True
    )

    assert f"/data/{today.name}/" in answer.content.decode()
    assert releases.releases().first() == today
    entry = AuditEntry.objects.get(action="make release")
    assert entry.subject == f"open data of {today.name}"


def test_an_editor_cannot_make_a_release(client: Client, released: Export) -> None:
    user = User.objects.create_user("eve", is_staff=True)
    Export.objects.update(release=False)
    client.force_login(user)

    client.post("/admin/results/export/", {"action": "make_releases", "_selected_action": [released.pk]})

    assert not releases.releases().exists()


def test_the_command_makes_the_newest_day_a_release(
    released: Export, capsys: pytest.CaptureFixture[str]
) -> None:
    today = exports.create_export()
    second = exports.create_export()
    Export.objects.update(release=False)

    call_command("results", "release")

    assert capsys.readouterr().out == f"/data/{today.name}/ is a release now\n"
    with pytest.raises(CommandError, match="is a release already"):
        call_command("results", "release")
    with pytest.raises(CommandError, match="no export '1999-01-01'"):
        call_command("results", "release", "1999-01-01")
    with pytest.raises(releases.ReleaseError, match="is an earlier export of"):
        releases.make_release(second, "ada")


@pytest.mark.parametrize("name", ["latest", "1999-01-01", "nonsense"])
def test_a_page_of_no_export_says_so(client: Client, db: None, name: str) -> None:
    answer = client.get(f"/data/{name}/")

    assert answer.status_code == (503 if name == "latest" else 404)
    assert ("Retry-After" in answer.headers) == (name == "latest")
