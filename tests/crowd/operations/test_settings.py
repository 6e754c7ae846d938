"""How the settings follow the environment; each case in a process of its own, as Django reads them once."""

import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
SHOW = (
    "import json, crowd.settings as s; print(json.dumps({'hosts': s.ALLOWED_HOSTS, 'https': s.HTTPS, "
    "'secure': s.SESSION_COOKIE_SECURE, 'debug': s.DEBUG, 'broker': s.CELERY_BROKER_URL, "
    "'engine': s.DATABASES['default']['ENGINE'], 'silenced': getattr(s, 'SILENCED_SYSTEM_CHECKS', [])}))"
)


def run(*arguments: str, var: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("FRONTRUNNER_", "DATABASE_"))
    }
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=kept | {"FRONTRUNNER_VAR": str(var)} | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def shown(var: Path, **environment: str) -> dict[str, Any]:
    done = run("-c", SHOW, var=var, **environment)
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_alone_it_serves_this_machine_over_plain_http(tmp_path: Path) -> None:
    settings = shown(tmp_path)

    assert settings["hosts"] == ["localhost", "127.0.0.1", "[::1]"]
    assert (settings["https"], settings["secure"], settings["debug"]) == (False, False, False)
    assert settings["engine"] == "django.db.backends.sqlite3"


def test_a_public_host_switches_https_on_and_silences_only_the_preload_list(tmp_path: Path) -> None:
    settings = shown(tmp_path, FRONTRUNNER_HOSTS="frontrunner.example")

    assert "frontrunner.example" in settings["hosts"]
    assert (settings["https"], settings["secure"], settings["silenced"]) == (True, True, ["security.W021"])


def test_other_databases_and_brokers_come_from_the_environment(tmp_path: Path) -> None:
    settings = shown(
        tmp_path,
        DATABASE_URL="postgres://a:b@db.example/frontrunner",
        CELERY_BROKER_URL="redis://redis.example/0",
    )

    assert settings["engine"] == "django.db.backends.postgresql"
    assert settings["broker"] == "redis://redis.example/0"


def test_the_deployment_checks_pass_with_a_name_as_without_one(tmp_path: Path) -> None:
    checked = ("manage.py", "check", "--deploy", "--fail-level", "WARNING")  # as `make check` does
    done = run(*checked, var=tmp_path, FRONTRUNNER_HOSTS="frontrunner.example")

    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_secret_key_is_kept_and_its_owners_alone(tmp_path: Path) -> None:
    show = "import crowd.settings as s; print(s.SECRET_KEY)"

    first, second = (run("-c", show, var=tmp_path).stdout for _ in range(2))

    assert len(first.strip()) >= 50
    assert first == second
    assert stat.S_IMODE((tmp_path / "secret_key").stat().st_mode) == 0o600


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("FRONTRUNNER_PORT", "http", "=http: give a whole number, such as 8000"),
        ("FRONTRUNNER_LEASE_SECONDS", "1", "=1: give 2 or more"),
        ("FRONTRUNNER_WATCHERS", "10.0.0.1/8", ": 10.0.0.1/8 has host bits set; give"),
    ],
)
def test_a_wrong_setting_is_one_clear_line(tmp_path: Path, name: str, value: str, text: str) -> None:
    done = run("manage.py", "serve", var=tmp_path, **{name: value})

    [line] = done.stderr.strip().splitlines()
    assert done.returncode == 1
    assert line.startswith(f"frontrunner: {name}{text}")


@pytest.mark.slow
def test_limits_follow_one_factor(tmp_path: Path) -> None:
    show = "import crowd.settings as s; print(s.FRONTRUNNER_READS_PER_MINUTE, s.FRONTRUNNER_VALUES_PER_DAY)"

    for factor, expected in (("0", "0 0"), ("2", "1200 4000000")):
        assert run("-c", show, var=tmp_path, FRONTRUNNER_LIMITS=factor).stdout.strip() == expected


def test_a_data_folder_that_cannot_be_made_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()

    done = run("manage.py", "serve", var=tmp_path / "file" / "var")

    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert "FRONTRUNNER_VAR" in done.stderr


@pytest.mark.slow
def test_ctrl_c_ends_any_command_without_a_traceback(tmp_path: Path) -> None:
    done = run("manage.py", "shell", "--no-imports", "-c", "raise KeyboardInterrupt", var=tmp_path)

    assert done.returncode == 130
    assert done.stderr == ""


@pytest.mark.slow
def test_the_first_administrator_can_be_made_before_anything_else(tmp_path: Path) -> None:
    done = run("manage.py", "first_admin", var=tmp_path)

    assert done.returncode == 0, done.stderr
    assert "password" in done.stdout


@pytest.mark.parametrize("address", ["bucket/folder", "s3://", "https://s3.example/bucket", "s3://b/folder/"])
def test_what_is_no_bucket_is_named(address: str, tmp_path: Path) -> None:
    done = run("-c", SHOW, var=tmp_path, FRONTRUNNER_BUCKET=address)

    assert f"FRONTRUNNER_BUCKET={address}: give a text such as s3://bucket/folder" in done.stderr


def test_missing_packages_of_a_bucket_are_named(tmp_path: Path) -> None:
    missing = "import sys; sys.modules['boto3'] = None; import crowd.settings"

    done = run("-c", missing, var=tmp_path, FRONTRUNNER_BUCKET="s3://bucket")

    assert "FRONTRUNNER_BUCKET is set, but boto3 is missing" in done.stderr
    assert "requirements-s3.lock" in done.stderr
