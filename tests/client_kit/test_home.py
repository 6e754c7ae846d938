"""The client's folder: private, written whole or not at all, and honest about what is wrong with it."""

import errno
import os
import stat
from pathlib import Path

import pytest

from client_kit.delivery import consent
from client_kit.errors import HomeError
from client_kit.home import Home, write_file
from groundwork.folders import user_folder


def test_the_folder_is_the_platforms_unless_the_environment_names_one() -> None:
    assert user_folder({"FRONTRUNNER_HOME": "/data/f"}, "linux") == Path("/data/f")
    assert user_folder({"XDG_DATA_HOME": "/data"}, "linux") == Path("/data/frontrunner")
    assert user_folder({}, "linux") == Path.home() / ".local/share/frontrunner"
    assert user_folder({}, "darwin") == Path.home() / "Library/Application Support/frontrunner"
    assert user_folder({"LOCALAPPDATA": "/l"}, "win32") == Path("/l/frontrunner")


def test_documents_come_back_and_only_their_owner_can_read_them(home: Home) -> None:
    home.write("a.json", {"token": "secret"})

    assert home.read("a.json") == {"token": "secret"}
    assert home.read("b.json") == {}
    assert stat.S_IMODE((home.path / "a.json").stat().st_mode) == 0o600


def test_a_damaged_document_is_named(home: Home) -> None:
    (home.path / "a.json").write_text("{")

    with pytest.raises(HomeError, match=r"a\.json is damaged"):
        home.read("a.json")


def test_a_folder_that_cannot_be_made_is_an_error_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(HomeError, match="set FRONTRUNNER_HOME to a writable folder"):
        Home(tmp_path / "file" / "home").prepare()


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a"
    write_file(path, b"old")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(HomeError, match="a cannot be written: No space left on device"):
        write_file(path, b"new")

    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_consent_holds_for_one_version_and_one_server(home: Home) -> None:
    consent.remember(home, "https://one.example", 1)

    assert consent.is_agreed(home, "https://one.example", 1)
    assert not consent.is_agreed(home, "https://one.example", 2)
    assert not consent.is_agreed(home, "https://two.example", 1)
    consent.withdraw(home)
    assert not consent.is_agreed(home, "https://one.example", 1)


def test_the_consent_text_shows_what_this_device_would_send() -> None:
    text = consent.text("https://one.example", 3, 17_200_000, {"device": {"model": "Pixel 8", "cpu": None}})

    for shown in ("https://one.example", '"model": "Pixel 8"', '"cpu": null', "17 MB", "Consent 3."):
        assert shown in text
