"""From a draft to a published front and back: permitted steps, their log, and what holds content fixed."""

from collections.abc import Callable
from typing import Any

import pytest
from django.contrib.auth.models import Group, User
from django.core.exceptions import ValidationError
from django.core.management import CommandError, call_command
from django.db import IntegrityError, connection, transaction
from django.db.models import ProtectedError
from django.test import Client

from crowd.audit import guards as audit_guards
from crowd.audit.models import AppendOnlyError, AuditEntry
from crowd.fronts import intake_policy, manifests, selectors, sequences
from crowd.fronts.models import FrontVersion, FrozenFrontError, TransitionError
from crowd.fronts.publishing import guards, second_person, services
from tests.builders.documents import front_document
from tests.crowd.guarded import refused_by_the_database


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
    preview = manifests.content(selectors.front_in_any_state(draft.pk), intake_policy.current())

    services.publish(draft)

    answer = client.get("/api/v1/manifest")
    assert (answer.content, answer["ETag"]) == (preview, manifests.etag(preview))


def test_content_is_fixed_from_the_review_on(draft: FrontVersion, pack: dict[str, Any]) -> None:
    services.submit(draft)

    with pytest.raises(services.FrontConflictError, match="another version"):
        services.create_draft(front_document(pack, version="1", provenance={}))
    draft.document = "{}"
    with pytest.raises(FrozenFrontError):
        draft.save()
    with pytest.raises(ValidationError, match="row by row"):
        FrontVersion.objects.filter(state="draft").update(state="published")


def test_the_database_itself_refuses_to_change_what_is_out_of_draft(draft: FrontVersion) -> None:
    configuration = f"UPDATE {guards.CONFIGURATION} SET name = 'fastest' WHERE name = 'best'"
    another = f"INSERT INTO {guards.CONFIGURATION} (front_id, name, position) VALUES ({draft.pk}, 'more', 9)"
    with connection.cursor() as cursor:
        cursor.execute(f"UPDATE {guards.FRONT} SET document = document")
        cursor.execute(f"UPDATE {guards.CONFIGURATION} SET name = name")
    refused_by_the_database(f"UPDATE {guards.FRONT} SET state = 'published', published_at = created_at")

    services.submit(draft)

    refused_by_the_database(f"UPDATE {guards.FRONT} SET digest = '0'")
    refused_by_the_database(f"UPDATE {guards.FRONT} SET document = '{{}}'")
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

    with pytest.raises(ValidationError, match="is kept"):
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
    entry.actor = "forger"

    for change in (entry.save, entry.delete, AuditEntry.objects.all().delete):
        with pytest.raises(AppendOnlyError):
            change()
    with pytest.raises(AppendOnlyError):
        AuditEntry.objects.update(actor="forger")
    assert AuditEntry.objects.get().actor == "anna"


def test_the_database_itself_keeps_the_log(draft: FrontVersion) -> None:
    refused_by_the_database(f"UPDATE {audit_guards.TABLE} SET actor = 'forger'")
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

    with pytest.raises(services.FrontConflictError, match="does not match its digest"):
        services.publish(draft)
    with pytest.raises(CommandError, match="does not match its digest"):
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


def test_an_author_with_another_spelling_of_the_name_is_no_second_person(
    draft: FrontVersion, settings: Any
) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    services.submit(draft, by="paul")

    with pytest.raises(second_person.SecondPersonError):
        services.publish(draft, by="Paul")


def test_an_author_whose_account_was_renamed_is_no_second_person(draft: FrontVersion, settings: Any) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    account = User.objects.create_user("paul")
    services.submit(draft, by="paul")
    account.username = "mary"
    account.save()

    with pytest.raises(second_person.SecondPersonError):
        services.publish(draft, by="mary")


def test_two_people_retire_where_that_is_demanded(draft: FrontVersion, settings: Any) -> None:
    services.publish(services.submit(draft, by="anna"), by="paul")
    settings.FRONTRUNNER_SECOND_PERSON = True

    for _ in range(2):
        with pytest.raises(second_person.SecondPersonError, match="another person must retire it, too"):
            services.retire(draft, by="maria")
    with pytest.raises(second_person.SecondPersonError, match="the command line does not say who you are"):
        services.retire(draft)
    assert FrontVersion.objects.get().state == "published"
    assert AuditEntry.objects.filter(action="retirement asked", actor="maria").count() == 1

    assert services.retire(draft, by="paul").state == "retired"


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

    with pytest.raises(services.FrontConflictError, match="does not match its digest"):
        services.publish(read_as_a_draft)

    assert FrontVersion.objects.get().state == "in-review"


def test_a_draft_is_replaced_by_whoever_made_it_alone(draft: FrontVersion, pack: dict[str, Any]) -> None:
    better = front_document(pack, version="1", provenance={"note": "better"})

    with pytest.raises(services.FrontConflictError, match="kfusion-1 is a draft of anna"):
        services.create_draft(better, by="paul")
    assert FrontVersion.objects.get().digest == draft.digest

    assert services.create_draft(front_document(pack, version="1"), by="anna").digest == draft.digest
    assert services.create_draft(better, by="anna").content.provenance == {"note": "better"}
    services.discard(FrontVersion.objects.get(), by="anna")
    assert services.create_draft(front_document(pack, version="1"), by="paul").digest == draft.digest


def test_members_that_a_front_does_not_have_are_not_kept(db: None, pack: dict[str, Any]) -> None:
    plain = services.create_draft(front_document(pack))
    digest = plain.digest

    again = services.create_draft(front_document(pack, comment="learned elsewhere"))

    assert (again.pk, again.digest) == (plain.pk, digest)
