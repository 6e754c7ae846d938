"""From a draft to a published front and back: permitted steps, their log, and what holds content fixed."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from django.contrib.auth.models import Group
from django.core.exceptions import ValidationError
from django.core.management import CommandError, call_command
from django.db import IntegrityError, connection, transaction
from django.db.models import ProtectedError
from django.test import Client

from crowd.audit import guards as audit_guards
from crowd.audit.models import AppendOnlyError, AuditEntry
from crowd.fronts import manifests, policy, selectors, sequences
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion, FrozenFrontError, TransitionError
from crowd.fronts.publishing import guards, second_person, services
from crowd.operations import first_run
from tests.crowd.documents import front_document


@pytest.fixture
def draft(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A draft of a front that has no published version."""
    return services.create_draft(front_document(pack, version="1"), by="anna")


def steps() -> list[tuple[str, str, str, str]]:
    rows = AuditEntry.objects.order_by("pk")
    return [(row.actor, row.action, row.from_state, row.to_state) for row in rows]


def test_every_step_of_a_front_is_logged_with_who_and_which_content(draft: FrontVersion) -> None:
    services.submit(draft, by="anna")
    services.send_back(draft, by="paul", note="best is too slow")
    services.submit(draft, by="anna")
    services.publish(draft, by="paul")
    services.retire(draft, by="paul")

    assert steps() == [
        ("anna", "drafted", "", "draft"),
        ("anna", "submitted for review", "draft", "in-review"),
        ("paul", "sent back", "in-review", "draft"),
        ("anna", "submitted for review", "draft", "in-review"),
        ("paul", "published", "in-review", "published"),
        ("paul", "retired", "published", "retired"),
    ]
    assert {row.digest for row in AuditEntry.objects.all()} == {draft.digest}
    assert AuditEntry.objects.get(action="sent back").note == "best is too slow"


STEPS: dict[str, Callable[[FrontVersion], FrontVersion]] = {
    "submit": services.submit,
    "send_back": services.send_back,
    "publish": services.publish,
    "retire": services.retire,
}


@pytest.mark.parametrize(
    ("reached", "refused"),
    [
        ([], ["send_back", "publish", "retire"]),
        (["submit"], ["submit", "retire"]),
        (["submit", "publish"], ["submit", "send_back", "publish"]),
        (["submit", "publish", "retire"], ["submit", "send_back", "publish", "retire"]),
    ],
)
def test_only_permitted_steps_are_taken(draft: FrontVersion, reached: list[str], refused: list[str]) -> None:
    for step in reached:
        STEPS[step](draft)
    before = steps()

    for step in refused:
        with pytest.raises(TransitionError, match="cannot become"):
            STEPS[step](FrontVersion.objects.get())

    assert steps() == before


def test_of_two_who_decide_at_once_the_second_hears_what_the_first_did(draft: FrontVersion) -> None:
    services.submit(draft)
    seen_by_the_other = FrontVersion.objects.get()
    services.send_back(draft)

    with pytest.raises(TransitionError, match="is draft and cannot become published"):
        services.publish(seen_by_the_other)


def test_nothing_of_a_draft_or_a_review_is_public(client: Client, draft: FrontVersion) -> None:
    for state in ("draft", "in-review"):
        assert FrontVersion.objects.get().state == state
        assert client.get("/api/v1/manifest").status_code == 404
        assert client.get("/api/v1/fronts").json()["results"] == []
        assert client.get("/api/v1/fronts/kfusion-1").status_code == 404
        assert client.get("/fronts/kfusion-1/").status_code == 404
        assert client.get("/figures/fronts/kfusion-1.json").status_code == 404
        assert "kfusion-1" not in client.get("/fronts/").content.decode()
        if state == "draft":
            services.submit(draft)


def test_a_preview_is_what_clients_then_read(client: Client, draft: FrontVersion) -> None:
    services.submit(draft)
    preview = manifests.content(selectors.any_front(draft.pk), policy.current())

    services.publish(draft)

    answer = client.get("/api/v1/manifest")
    assert (answer.content, answer["ETag"]) == (preview, manifests.etag(preview))


def test_content_is_fixed_from_the_review_on(draft: FrontVersion, pack: dict[str, Any]) -> None:
    services.submit(draft)

    with pytest.raises(services.FrontConflictError, match="another version"):
        services.create_draft(front_document(pack, version="1", provenance={}))
    draft.provenance = {}
    with pytest.raises(FrozenFrontError):
        draft.save()
    with pytest.raises(ValidationError, match="row by row"):
        FrontVersion.objects.filter(state="draft").update(state="published")


def refused_by_the_database(statement: str) -> None:
    with pytest.raises(IntegrityError), transaction.atomic(), connection.cursor() as cursor:
        cursor.execute(statement)


def test_the_database_itself_refuses_to_change_what_is_out_of_draft(draft: FrontVersion) -> None:
    configuration = f"UPDATE {guards.CONFIGURATION} SET name = 'fastest' WHERE name = 'best'"
    another = (
        f"INSERT INTO {guards.CONFIGURATION} (front_id, name, position, parameters, predicted) "
        f"VALUES ({draft.pk}, 'more', 9, '{{}}', '{{}}')"
    )
    with connection.cursor() as cursor:
        cursor.execute(f"UPDATE {guards.FRONT} SET protocol = protocol")
        cursor.execute(f"UPDATE {guards.CONFIGURATION} SET name = name")
    refused_by_the_database(f"UPDATE {guards.FRONT} SET state = 'published', published_at = created_at")

    services.submit(draft)

    refused_by_the_database(f"UPDATE {guards.FRONT} SET digest = '0'")
    refused_by_the_database(f"UPDATE {guards.FRONT} SET protocol = '{{}}'")
    refused_by_the_database(f"UPDATE {guards.FRONT} SET state = 'retired', published_at = created_at")
    refused_by_the_database(configuration)
    refused_by_the_database(another)


def delete_past_the_models() -> None:
    with connection.cursor() as cursor:
        cursor.execute(f"DELETE FROM {guards.CONFIGURATION}")
        cursor.execute(f"DELETE FROM {guards.FRONT}")
    connection.check_constraints()


def test_the_database_keeps_a_front_that_was_in_review(draft: FrontVersion) -> None:
    services.submit(draft)
    services.send_back(draft)

    with pytest.raises(ValidationError, match="it is kept"):
        services.discard(draft)
    with pytest.raises(ProtectedError):
        draft.delete()
    with pytest.raises(IntegrityError), transaction.atomic():
        delete_past_the_models()


def test_a_draft_can_be_discarded_and_the_log_remembers_it(draft: FrontVersion) -> None:
    services.discard(draft, by="anna")

    assert not FrontVersion.objects.exists()
    assert steps()[-1] == ("anna", "discarded", "draft", "")


def test_the_log_is_only_added_to(draft: FrontVersion) -> None:
    entry = AuditEntry.objects.get()
    entry.actor = "nobody"

    for change in (entry.save, entry.delete, AuditEntry.objects.all().delete):
        with pytest.raises(AppendOnlyError):
            change()
    with pytest.raises(AppendOnlyError):
        AuditEntry.objects.update(actor="nobody")
    assert AuditEntry.objects.get().actor == "anna"


def test_the_database_itself_keeps_the_log(draft: FrontVersion) -> None:
    refused_by_the_database(f"UPDATE {audit_guards.TABLE} SET actor = 'nobody'")
    refused_by_the_database(f"DELETE FROM {audit_guards.TABLE}")
    if connection.vendor == "postgresql":
        connection.check_constraints()  # PostgreSQL truncates no table with checks to come
        refused_by_the_database(f"TRUNCATE {audit_guards.TABLE}")

    assert AuditEntry.objects.get().actor == "anna"


def test_emptying_the_whole_database_empties_the_log_and_protects_the_next_one(
    transactional_db: None, pack: dict[str, Any]
) -> None:
    services.create_draft(front_document(pack, version="1"))

    call_command("flush", verbosity=0, interactive=False)

    assert not AuditEntry.objects.exists()
    services.create_draft(front_document(pack, version="1"))
    refused_by_the_database(f"DELETE FROM {audit_guards.TABLE}")


def test_migrating_again_leaves_the_guards_in_place(draft: FrontVersion) -> None:
    services.submit(draft)

    call_command("migrate", verbosity=0)

    refused_by_the_database(f"UPDATE {guards.FRONT} SET digest = '0'")
    refused_by_the_database(f"DELETE FROM {audit_guards.TABLE}")


def test_content_that_does_not_fit_its_digest_is_neither_published_nor_exported(draft: FrontVersion) -> None:
    services.submit(draft)
    with connection.cursor() as cursor:
        cursor.execute(f"DELETE FROM {guards.CONFIGURATION} WHERE name = 'accurate'")

    with pytest.raises(services.FrontConflictError, match="does not fit its digest"):
        services.publish(draft)
    with pytest.raises(CommandError, match="does not fit its digest"):
        call_command("front", "export", "kfusion-1")
    assert FrontVersion.objects.get().state == "in-review"


def test_rolling_back_publishes_an_earlier_content_as_a_new_version(
    draft: FrontVersion, pack: dict[str, Any]
) -> None:
    services.publish(services.submit(draft))
    services.publish_content(front_document(pack, version="2", provenance={"note": "worse"}))

    again = services.publish_again(FrontVersion.objects.get(slug="kfusion-1"), by="paul")

    current, earlier = selectors.current("kfusion"), selectors.front("kfusion-1")
    assert current is not None
    assert earlier is not None
    assert (again.slug, current.slug) == ("kfusion-3", "kfusion-3")
    assert current.points == earlier.points
    assert current.provenance == earlier.provenance | {"published_again_from": "kfusion-1"}
    assert current.digest != earlier.digest
    assert steps()[-1] == ("paul", "published", "in-review", "published")
    assert AuditEntry.objects.first().note == "the content of kfusion-1 again"  # type: ignore[union-attr]


def test_a_draft_is_no_earlier_version(draft: FrontVersion) -> None:
    with pytest.raises(TransitionError):
        services.publish_again(draft)


def test_editors_prepare_and_publishers_decide(db: None) -> None:
    def may(role: str) -> set[str]:
        return set(Group.objects.get(name=role).permissions.values_list("codename", flat=True))

    assert "submit_frontversion" in may("editor")
    assert "publish_frontversion" not in may("editor")
    assert may("publisher") == may("editor") | {"publish_frontversion", "change_devicemodel"}
    assert not [name for name in may("publisher") if name.startswith("delete_")]


def test_two_people_publish_where_that_is_demanded(draft: FrontVersion, settings: Any) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    services.submit(draft, by="paul")

    for author in ("anna", "paul"):
        with pytest.raises(second_person.SecondPersonError, match=f"{author} drafted or submitted kfusion-1"):
            services.publish(draft, by=author)
    assert FrontVersion.objects.get().state == "in-review"

    assert services.publish(draft, by="maria").state == "published"


def test_only_the_authors_of_the_content_that_is_published_count(
    draft: FrontVersion, pack: dict[str, Any], settings: Any
) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    services.discard(draft, by="anna")
    other = services.create_draft(front_document(pack, version="1", provenance={}), by="paul")
    services.submit(other, by="paul")

    assert services.publish(other, by="anna").state == "published"


def test_a_front_published_again_waits_for_a_second_person(draft: FrontVersion, settings: Any) -> None:
    services.publish(services.submit(draft, by="anna"), by="paul")
    settings.FRONTRUNNER_SECOND_PERSON = True

    again = services.publish_again(draft, by="paul")

    assert (again.slug, again.state) == ("kfusion-2", "in-review")
    assert services.publish(again, by="anna").state == "published"


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
    assert list(first_run.publish_shipped_fronts())[1:] == ["Published the front kfusion-2: 3 configurations"]
    assert FrontVersion.objects.get(slug="kfusion-1").state == "in-review"


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
    worse["configurations"][1]["predicted"] |= {"runtime": 0.02, "ate_max": None}
    del worse["configurations"][2]
    path = tmp_path / "kfusion-2.json"
    path.write_text(json.dumps(worse))

    monkeypatch.setattr("sys.stdin", Terminal("n\n"))
    call_command("front", "publish", str(path))

    assert capsys.readouterr().out.splitlines() == [
        "Clients measure kfusion-2 instead of kfusion-1.",
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

    with pytest.raises(CommandError, match="kfusion-1: this is not a terminal to ask at, add --yes"):
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
        "kfusion-1: a draft now, manage.py front publish kfusion-1 makes clients measure it",
        "No front of kfusion is published now: kfusion-1 is the first.",
        "kfusion-1: published",
        "kfusion-1: retired",
    ]
    assert FrontVersion.objects.get().digest == digest
    assert {row.actor for row in AuditEntry.objects.exclude(actor="anna")} == {"command line"}


def test_what_is_stored_decides_and_not_what_somebody_read_long_ago(
    draft: FrontVersion, settings: Any
) -> None:
    read_as_a_draft = FrontVersion.objects.get()
    services.submit(draft)
    folders, settings.FRONTRUNNER_SEQUENCES = settings.FRONTRUNNER_SEQUENCES, []
    with pytest.raises(sequences.SequenceError):
        services.publish(read_as_a_draft)
    settings.FRONTRUNNER_SEQUENCES = folders
    with connection.cursor() as cursor:
        cursor.execute(f"DELETE FROM {guards.CONFIGURATION} WHERE name = 'accurate'")

    with pytest.raises(services.FrontConflictError, match="does not fit its digest"):
        services.publish(read_as_a_draft)

    assert FrontVersion.objects.get().state == "in-review"


def test_a_draft_is_replaced_by_whoever_made_it_alone(draft: FrontVersion, pack: dict[str, Any]) -> None:
    better = front_document(pack, version="1", provenance={"note": "better"})

    with pytest.raises(services.FrontConflictError, match="kfusion-1 is a draft of anna"):
        services.create_draft(better, by="paul")
    assert FrontVersion.objects.get().digest == draft.digest

    assert services.create_draft(front_document(pack, version="1"), by="anna").digest == draft.digest
    assert services.create_draft(better, by="anna").provenance == {"note": "better"}
    services.discard(FrontVersion.objects.get(), by="anna")
    assert services.create_draft(front_document(pack, version="1"), by="paul").digest == draft.digest


def test_members_that_a_front_does_not_have_are_not_kept(db: None, pack: dict[str, Any]) -> None:
    plain = services.create_draft(front_document(pack))
    digest = plain.digest

    again = services.create_draft(front_document(pack, comment="learned elsewhere"))

    assert (again.pk, again.digest) == (plain.pk, digest)


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
    with pytest.raises(CommandError, match=r"no front kfusion-9 \(there: kfusion-1\)"):
        call_command("front", "publish", "kfusion-9")


def test_fronts_of_an_earlier_release_are_kept_logged_and_guarded(
    transactional_db: None, pack: dict[str, Any]
) -> None:
    call_command("migrate", "fronts", "0001", verbosity=0)
    content = front_document(pack)
    with connection.cursor() as cursor:
        cursor.execute(
            f"INSERT INTO {guards.FRONT} (slug, application, version, state, digest, protocol, sequence, "
            "provenance, created_at, published_at) VALUES ('kfusion-test', 'kfusion', 'test', 'published', "
            "%s, %s, %s, %s, '2026-01-01 00:00:00', '2026-01-02 00:00:00')",
            [
                front_file.digest(content),
                *(json.dumps(value) for value in (content["protocol"], pack, content["provenance"])),
            ],
        )

    call_command("migrate", verbosity=0)

    front = FrontVersion.objects.get()
    assert (front.state, front.protocol) == ("published", content["protocol"])
    entry = AuditEntry.objects.get()
    assert (entry.actor, entry.action, entry.front, entry.digest) == (
        "unknown",
        "published",
        front,
        front.digest,
    )
    assert entry.at == front.published_at
    refused_by_the_database(f"UPDATE {guards.FRONT} SET digest = '0'")


def test_a_front_in_review_is_a_draft_again_for_an_earlier_release(
    transactional_db: None, pack: dict[str, Any]
) -> None:
    services.submit(services.create_draft(front_document(pack, version="1")))
    services.publish_content(front_document(pack, version="2"))
    logged = AuditEntry.objects.count()

    call_command("migrate", "fronts", "0002", verbosity=0)
    call_command("migrate", verbosity=0)
    assert AuditEntry.objects.count() == logged
    call_command("migrate", "fronts", "0001", verbosity=0)
    with connection.cursor() as cursor:
        cursor.execute(f"SELECT slug, state FROM {guards.FRONT} ORDER BY slug")
        assert cursor.fetchall() == [("kfusion-1", "draft"), ("kfusion-2", "published")]
    call_command("migrate", verbosity=0)

    states = FrontVersion.objects.order_by("slug").values_list("state", flat=True)
    assert list(states) == ["draft", "published"]


def test_the_log_of_an_earlier_release_is_kept(transactional_db: None, pack: dict[str, Any]) -> None:
    services.submit(services.create_draft(front_document(pack, version="1"), by="anna"), by="anna")
    entries = list(AuditEntry.objects.values())
    call_command("migrate", "fronts", "0004", verbosity=0)
    with connection.cursor() as cursor:
        cursor.execute("SELECT slug, action FROM fronts_auditentry ORDER BY id")
        assert cursor.fetchall() == [("kfusion-1", "drafted"), ("kfusion-1", "submitted for review")]

    call_command("migrate", verbosity=0)

    assert list(AuditEntry.objects.values()) == entries
    refused_by_the_database(f"DELETE FROM {audit_guards.TABLE}")
    assert FrontVersion.objects.get().audit.get().action == "submitted for review"
