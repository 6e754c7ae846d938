"""The check list before a server is public: what it finds, its page and its command."""

import subprocess
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from django.contrib.auth.models import Group, User
from django.core.management import CommandError, call_command
from django.db import connection
from django.test import Client
from django.urls import reverse
from django.utils import timezone
from django_otp.plugins.otp_totp.models import TOTPDevice

from crowd.audit.models import AuditEntry
from crowd.fronts.models import FrontVersion, IntakePolicy
from crowd.operations import broker
from crowd.operations.public import checks, people, service
from crowd.operations.public.check_result import Answer, CheckResult
from crowd.results.figures import sessions
from crowd.results.models import Export, MeasurementSession, WorkerPulse
from tests.builders.documents import submission_document
from tests.builders.participant import Participant
from tests.crowd.roles import browser_of
from tests.dashboard.reading import text

pytestmark = pytest.mark.django_db
PAGE = "admin:public"
UNKNOWN_ON_ANY = {"Monitoring"}


def line(title: str) -> CheckResult:
    (result,) = [one for one in checks.run() if one.title == title]
    return result


@pytest.fixture(autouse=True)
def a_clock_that_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Machines that run tests say different things."""
    monkeypatch.setattr(service, "_follows_a_time_server", lambda: True)


@pytest.fixture
def ready(settings: Any, own_data_folder: Path, front: FrontVersion, monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that is ready, except for what tests cannot change in settings."""
    settings.PUBLIC_HOSTS = ["frontrunner.example"]
    settings.HTTPS = settings.SECURE_SSL_REDIRECT = True
    settings.SESSION_COOKIE_SECURE = settings.CSRF_COOKIE_SECURE = True
    settings.SECURE_HSTS_SECONDS, settings.SECURE_HSTS_INCLUDE_SUBDOMAINS = 3600, True
    settings.SILENCED_SYSTEM_CHECKS = ["security.W021"]
    settings.SECRET_KEY = "a key of many different characters, 0123456789 and more of them"
    settings.REST_FRAMEWORK = settings.REST_FRAMEWORK | {"NUM_PROXIES": 1}
    settings.FRONTRUNNER_OPERATOR = "The Lab"
    settings.FRONTRUNNER_CONTACT = "lab@frontrunner.example"
    settings.FRONTRUNNER_QUORUM, settings.FRONTRUNNER_RARE_BELOW = 3, 5
    settings.FRONTRUNNER_SECOND_PERSON = settings.FRONTRUNNER_REQUIRE_TOTP = True
    for name in ("ada", "bob"):
        user = User.objects.create_user(name, is_staff=True)
        user.groups.add(Group.objects.get(name="publisher"))
        TOTPDevice.objects.create(user=user, name="app", confirmed=True)
    for name in people.CONFIRMATIONS:
        people.confirm(name, "ada")
    for task in ("sweep", "backup"):
        sessions.record_pulse(task)
    now = timezone.now()
    Export.objects.create(started_at=now, touched_at=now, published_at=now)
    # A small disk is a fact of the machine that runs the test.
    monkeypatch.setattr(service, "LEAST_FREE_BYTES", 1)


@pytest.mark.slow
def test_the_bucket_is_written_read_and_emptied(
    bucket: Any, settings: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert line("Bucket").answer is Answer.PASSED
    assert list(bucket.object_versions.all()) == []

    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    settings.STORAGES = dict(settings.STORAGES)  # Django forgets its connections
    assert line("Bucket").answer is Answer.TO_DO
    assert "Could not connect" in line("Bucket").finding


def test_a_server_that_is_ready_has_nothing_to_do(ready: None) -> None:
    results = checks.run()

    assert [one for one in results if one.answer is Answer.TO_DO] == []
    assert {one.title for one in results if one.answer is Answer.UNKNOWN} == UNKNOWN_ON_ANY
    call_command("check_public")


Break = Callable[[Any], object]
BROKEN: list[tuple[str, Break, str]] = [
    ("Host names", lambda s: setattr(s, "PUBLIC_HOSTS", []), "FRONTRUNNER_HOSTS"),
    ("Host names", lambda s: setattr(s, "PUBLIC_HOSTS", ["*"]), "without *"),
    ("HTTPS", lambda s: setattr(s, "HTTPS", False), "certificate"),
    ("Debug pages", lambda s: setattr(s, "DEBUG", True), "DEBUG=0"),
    ("Django's checks", lambda s: setattr(s, "SECURE_SSL_REDIRECT", False), "check --deploy"),
    ("Operator and contact", lambda s: setattr(s, "FRONTRUNNER_CONTACT", ""), "set FRONTRUNNER_CONTACT;"),
    ("Limits on requests", lambda s: setattr(s, "FRONTRUNNER_READS_PER_MINUTE", 0), "number above 0"),
    (
        "Proxies",
        lambda s: setattr(s, "REST_FRAMEWORK", s.REST_FRAMEWORK | {"NUM_PROXIES": 0}),
        "FRONTRUNNER_PROXIES",
    ),
    ("Masks", lambda s: setattr(s, "FRONTRUNNER_QUORUM", 1), "private server"),
    ("Privacy text", lambda s: setattr(s, "FRONTRUNNER_CONSENT_VERSION", 99), "confirm it"),
    ("One-time passwords", lambda s: setattr(s, "FRONTRUNNER_REQUIRE_TOTP", False), "REQUIRE_TOTP=1"),
    (
        "One-time passwords",
        lambda _: User.objects.create_user("eve", is_staff=True),
        "frontrunner admin totp",
    ),
    ("Second person", lambda s: setattr(s, "FRONTRUNNER_SECOND_PERSON", False), "SECOND_PERSON=1"),
    ("Second person", lambda _: User.objects.filter(username="bob").update(is_active=False), "publisher"),
    ("Worker and beat", lambda _: WorkerPulse.objects.filter(task="sweep").delete(), "start both"),
    ("Fronts", lambda _: FrontVersion._base_manager.update(state="retired"), "publish a front"),
    ("Intake", lambda _: IntakePolicy.objects.create(accepting=False), "Intake policy"),
    ("Open data", lambda _: Export.objects.all().delete(), "frontrunner admin results export"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("title", "broken", "remedy"), BROKEN)
def test_a_problem_is_reported_with_what_to_do(
    ready: None, settings: Any, title: str, broken: Break, remedy: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert line(title).answer is Answer.PASSED
    broken(settings)

    result = line(title)
    assert result.answer is Answer.TO_DO
    assert remedy in result.remedy
    with pytest.raises(CommandError, match="to do before the server is public"):
        call_command("check_public")
    assert f"{title}: {result.finding}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("title", "task"), [("Worker and beat", "sweep"), ("Backup", "backup")], ids=["worker", "backup"]
)
def test_what_ran_long_ago_is_to_do(ready: None, title: str, task: str) -> None:
    WorkerPulse.objects.filter(task=task).update(at=timezone.now() - timedelta(days=3))

    assert line(title).answer is Answer.TO_DO
    assert "3 days ago" in line(title).finding


def test_a_backup_is_remembered(ready: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    WorkerPulse.objects.filter(task="backup").delete()
    on_sqlite = connection.vendor == "sqlite"
    assert line("Backup").answer is (Answer.TO_DO if on_sqlite else Answer.UNKNOWN)
    made = type("About", (), {"vendor": connection.vendor, "files": {"database": ""}})()
    monkeypatch.setattr("crowd.operations.backup.make", lambda file: file.touch() or made)

    call_command("backup", tmp_path / "today.tar.gz")

    assert line("Backup").answer is Answer.PASSED


def test_a_full_disk_is_to_do(ready: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "LEAST_FREE_BYTES", 1 << 60)

    assert line("Disk").answer is Answer.TO_DO


def test_a_secret_key_that_others_can_read_is_to_do(
    ready: None, settings: Any, own_data_folder: Path
) -> None:
    file = own_data_folder / "secret_key"
    file.write_text(settings.SECRET_KEY)
    file.chmod(0o600)
    assert line("Secret key").answer is Answer.PASSED
    file.chmod(0o644)

    assert line("Secret key").remedy == f"chmod 600 {file}"


def test_a_broker_that_does_not_answer_is_to_do(ready: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker, "state", lambda: "does not answer: OSError")

    assert line("Broker").finding == "does not answer: OSError"


def test_a_clock_behind_what_was_stored_is_to_do(
    ready: None, settings: Any, participant: Participant
) -> None:
    settings.SECURE_SSL_REDIRECT = False  # for the test's client
    participant.submit(submission_document())
    assert line("Clocks").answer is Answer.PASSED
    MeasurementSession.objects.update(received_at=timezone.now() + timedelta(minutes=5))

    assert line("Clocks").answer is Answer.TO_DO


@pytest.mark.parametrize(
    ("ahead", "finding"), [(9.0, "9 s ahead of the database's"), (-9.0, "9 s behind the database's")]
)
def test_another_clock_in_the_database_is_to_do(
    ready: None, ahead: float, finding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "_seconds_ahead_of_database", lambda: ahead)

    assert line("Clocks").answer is Answer.TO_DO
    assert finding in line("Clocks").finding


@pytest.mark.parametrize(
    ("said", "code", "expected"), [("yes\n", 0, True), ("no\n", 0, False), ("", 1, None), ("odd", 0, None)]
)
def test_systemd_is_asked_whether_the_clock_is_followed(
    said: str, code: int, expected: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    answer = subprocess.CompletedProcess([], code, stdout=said)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: answer)

    assert service._follows_a_time_server() is expected


def test_what_only_a_person_knows_is_confirmed_on_the_page_and_logged(admin_client: Client) -> None:
    address = reverse(PAGE)
    assert "I confirm: Privacy text" in admin_client.get(address).content.decode()

    answer = admin_client.post(address, {"confirm": "privacy"}, follow=True)

    assert line("Privacy text").answer is Answer.PASSED
    assert "I confirm: Privacy text" not in answer.content.decode()
    assert AuditEntry.objects.get(action="privacy text reviewed").actor == "admin"
    assert admin_client.post(address, {"confirm": "anything"}).status_code == 403


def test_the_page_shows_each_line_with_what_to_do(admin_client: Client) -> None:
    page = text(admin_client.get(reverse(PAGE)))

    for one in checks.run():
        assert one.title in page
        if one.confirms:
            assert one.remedy in page
    assert "Before you go public" in text(admin_client.get(reverse("admin:index")))


@pytest.mark.parametrize("role", ["", "editor", "publisher"])
def test_only_superusers_see_the_check_list(role: str) -> None:
    browser = browser_of(role)

    assert browser.get(reverse(PAGE)).status_code == 403
    assert browser.post(reverse(PAGE), {"confirm": "privacy"}).status_code == 403
    assert "Before you go public" not in text(browser.get(reverse("admin:index")))
    assert not AuditEntry.objects.filter(actor__endswith="-1").exists()


@pytest.mark.parametrize(
    ("contact", "address"),
    [
        ("lab@frontrunner.example", "mailto:lab@frontrunner.example"),
        ("https://frontrunner.example/contact@lab", "https://frontrunner.example/contact@lab"),
    ],
)
def test_participants_see_who_runs_the_server(
    client: Client, settings: Any, contact: str, address: str
) -> None:
    settings.FRONTRUNNER_OPERATOR, settings.FRONTRUNNER_CONTACT = "The <Lab>", contact

    page = client.get("/about/").content.decode()

    assert "This server is run by The &lt;Lab&gt;." in page
    assert f'<a href="{address}">{contact}</a>' in page


def test_a_server_without_an_operator_says_nothing_of_one(client: Client) -> None:
    assert "This server is run by" not in client.get("/about/").content.decode()
