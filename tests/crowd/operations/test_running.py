"""What keeps a server running: what it needs before it serves, and logs that do not grow for ever."""

import os
import stat
from pathlib import Path

import pytest
from django.contrib.auth.models import User
from django.core.management import call_command

from crowd.explorations.models import ReferenceDevice
from crowd.observability import metrics
from crowd.operations import supervision
from crowd.operations.supervision import Child
from tests.services.serving import command


@pytest.mark.slow
def test_preparing_again_changes_and_says_nothing(
    db: None, own_data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call_command("prepare")
    first = capsys.readouterr().out
    left = own_data_folder / "metrics" / "web-1-1.json"
    left.parent.mkdir()
    left.write_text("[]")

    call_command("prepare")

    assert "password" in first
    assert "password" not in capsys.readouterr().out
    assert ReferenceDevice.objects.filter(elsewhere="").count() == 1
    assert (own_data_folder / "static" / "dashboard").is_dir()
    assert not left.exists()


@pytest.mark.slow
def test_a_start_closes_the_data_folder_to_other_users_and_says_so(
    db: None, own_data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    database = own_data_folder / "database.sqlite3"
    database.touch(mode=0o644)
    own_data_folder.chmod(0o755)

    call_command("prepare")

    assert "were open to other users of this machine" in capsys.readouterr().out
    assert [stat.S_IMODE(path.stat().st_mode) for path in (database, own_data_folder)] == [0o600, 0o700]


@pytest.mark.slow
def test_a_start_makes_missing_static_files_again(tmp_path: Path) -> None:
    static = tmp_path / "var" / "static"
    assert command(tmp_path / "var", "prepare").returncode == 0
    before = {path.relative_to(static) for path in static.rglob("*")}
    (lost,) = static.glob("dashboard/style.*.css")
    lost.unlink()

    assert command(tmp_path / "var", "prepare").returncode == 0

    assert {path.relative_to(static) for path in static.rglob("*")} == before


@pytest.mark.slow
def test_a_start_names_accounts_that_differ_only_in_case(
    db: None, own_data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    User.objects.bulk_create([User(username="ann"), User(username="Ann")])

    call_command("prepare")

    assert "The accounts ann and Ann differ only in case" in capsys.readouterr().out


@pytest.mark.slow
def test_a_command_writes_for_its_own_user_alone(tmp_path: Path) -> None:
    ended = command(tmp_path / "var", "prepare")

    assert ended.returncode == 0, ended.stderr
    written = [tmp_path / "var", *(tmp_path / "var").rglob("*")]
    assert len(written) > 10
    assert [path for path in written if path.stat().st_mode & 0o077] == []


def test_a_large_log_is_put_aside_while_its_process_writes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervision, "LARGEST_LOG_BYTES", 1000)
    child = Child("test", [], tmp_path / "web.log", os.environ, tmp_path)
    with child.log.open("ab", buffering=0) as process:
        process.write(b"a" * 1000)
        child.shorten_log()
        assert child.log.stat().st_size == 1000

        process.write(b"b")
        child.shorten_log()
        process.write(b"c")

    assert child.log.read_bytes() == b"c"
    assert (tmp_path / "web.old.log").read_bytes() == b"a" * 1000 + b"b"


def test_a_log_that_cannot_be_put_aside_is_cut_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervision, "LARGEST_LOG_BYTES", 10)
    child = Child("test", [], tmp_path / "web.log", os.environ, tmp_path)
    child.log.write_bytes(b"a" * 100)
    (tmp_path / "web.old.log").mkdir()

    child.shorten_log()

    assert child.log.read_bytes() == b""


def test_forgetting_where_nothing_was_left_is_no_error(tmp_path: Path) -> None:
    metrics.remove_old_copies(tmp_path / "absent")

    assert not (tmp_path / "absent").exists()
