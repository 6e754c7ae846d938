"""A damaged database: each command names it and the way to restore it, in one line."""

import os
import shutil
from pathlib import Path

import pytest

from tests.services import intake
from tests.services.program import free_port
from tests.services.serving import command, commands, each, refusal

PAGE = 4096
DATABASE = "frontrunner.sqlite3"
COMMANDS = ("migrate", "exploration status", "front export kfusion-test", "backup FILE")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder, and a backup of it beside it."""
    var = tmp_path_factory.mktemp("damage") / "var"
    intake.prepare(var, {})
    commands(var, f"backup {var.parent / 'backup.tar.gz'}")
    return var


def damaged(prepared: Path, tmp_path: Path, start: int, pages: int, cut: bool) -> Path:
    """A copy of `prepared`: noise from page `start` on, and the file `cut` there or not."""
    var = tmp_path / "var"
    shutil.copytree(prepared, var)
    with (var / DATABASE).open("r+b") as file:
        file.seek(start * PAGE)
        if cut:
            file.truncate()
        else:
            file.write(os.urandom(pages * PAGE))
    return var


def assert_named(var: Path, *lines: str) -> None:
    """Each of `lines` names the damage."""
    lines = tuple(line.replace("FILE", str(var / "copy.tar.gz")) for line in lines)
    for done in each(var, *lines, FRONTRUNNER_PORT=str(free_port())):
        message = refusal(done)
        assert message.startswith(f"frontrunner: the database {var / DATABASE} is damaged")
        assert "frontrunner admin restore FILE" in message
    assert not (var / "copy.tar.gz").exists()


def test_a_file_that_is_cut_short_is_named_by_every_command(prepared: Path, tmp_path: Path) -> None:
    assert_named(damaged(prepared, tmp_path, start=50, pages=0, cut=True), *COMMANDS)


@pytest.mark.parametrize("start", [0, 100])
def test_a_file_that_is_overwritten_is_named(prepared: Path, tmp_path: Path, start: int) -> None:
    assert_named(damaged(prepared, tmp_path, start, pages=100, cut=False), "serve", "backup FILE")


def test_what_the_message_says_brings_the_data_back(prepared: Path, tmp_path: Path) -> None:
    var = damaged(prepared, tmp_path, start=0, pages=1, cut=False)
    done = command(var, "front", "export", "kfusion-test")
    assert "is damaged" in refusal(done)

    (var / DATABASE).rename(tmp_path / DATABASE)
    backup = prepared.parent / "backup.tar.gz"
    assert '"kfusion"' in commands(var, f"restore {backup}", "front export kfusion-test")


def test_a_database_that_does_not_answer_is_named(tmp_path: Path) -> None:
    address = f"postgres://user:secret@127.0.0.1:{free_port()}/frontrunner"
    done = command(tmp_path / "var", "migrate", DATABASE_URL=address)

    message = refusal(done)
    assert message.startswith("frontrunner: the database of DATABASE_URL does not answer")
    assert "secret" not in message
