"""Settings from environment variables, and the data folder."""

import contextlib
import importlib.util
import os
import re
import secrets
import stat
from ipaddress import IPv4Network, IPv6Network, ip_network
from pathlib import Path


class SettingError(Exception):
    """A setting is not valid; the message names the variable, its value and the remedy."""


class DataFolderError(SettingError):
    """The data folder cannot be written; the message names it and the remedy."""


def switch(name: str, default: bool = False) -> bool:
    """The environment variable `name` as a switch: 1, true, yes and on are on."""
    return os.environ.get(name, "1" if default else "0").strip().lower() in {"1", "true", "yes", "on"}


def choice(name: str, default: str, *others: str) -> str:
    """The environment variable `name` as `default` or one of `others`. Raises SettingError otherwise."""
    text = os.environ.get(name, default)
    if text not in (default, *others):
        raise SettingError(f"{name}={text}: give {' or '.join((default, *others))}")
    return text


def integer(name: str, default: int, least: int = 0, most: int | None = None) -> int:
    """The environment variable `name` as a whole number from `least` to `most`.

    Raises SettingError otherwise.
    """
    text = os.environ.get(name, str(default))
    if not text.isdecimal():
        raise SettingError(f"{name}={text}: give a whole number, such as {default}")
    if int(text) < least or (most is not None and int(text) > most):
        bounds = f"{least} or more" if most is None else f"one from {least} to {most}"
        raise SettingError(f"{name}={text}: give {bounds}")
    return int(text)


def matching(name: str, default: str, pattern: str, example: str) -> str:
    """The environment variable `name` as a text that fully matches `pattern`.

    Raises SettingError otherwise.
    """
    text = os.environ.get(name, default)
    if not re.fullmatch(pattern, text):
        raise SettingError(f"{name}={text}: give a text such as {example}")
    return text


def bucket() -> str:
    """FRONTRUNNER_BUCKET. Raises SettingError if it is not an address, or its packages are missing."""
    address = matching("FRONTRUNNER_BUCKET", "", r"(s3://[^/\s]+(/[^/\s]+)*)?", "s3://bucket/folder")
    if address and importlib.util.find_spec("boto3") is None:
        raise SettingError(
            "FRONTRUNNER_BUCKET is set, but boto3 is missing: remove it, or install the packages "
            "with python -m pip install --require-hashes -r requirements-s3.lock"
        )
    return address


def networks(name: str) -> tuple[IPv4Network | IPv6Network, ...]:
    """The environment variable `name` as networks, separated by commas. Raises SettingError otherwise."""
    texts = [text.strip() for text in os.environ.get(name, "").split(",") if text.strip()]
    try:
        return tuple(ip_network(text) for text in texts)
    except ValueError as error:
        raise SettingError(f"{name}: {error}; give networks such as 10.0.0.5/32,fd00::/8") from error


def make_writable_folder(folder: Path) -> Path:
    """Make `folder` if it is missing, and return it. Raises DataFolderError if it cannot be written."""
    remedy = f"choose another with FRONTRUNNER_VAR, or: make run DATA=FOLDER (now {folder})"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataFolderError(f"the data folder cannot be made ({error.strerror}): {remedy}") from error
    # os.access is not reliable for root and on network file systems: write a file.
    probe = folder / f".probe-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise DataFolderError(f"the data folder is not writable ({error.strerror}): {remedy}") from error
    return folder


def close_to_others(folder: Path) -> int:
    """Take the rights of other users to `folder` and all in it away. Returns how many had some."""
    others = stat.S_IRWXG | stat.S_IRWXO
    closed = 0
    for path in (folder, *folder.rglob("*")):
        # Another process may delete a file meanwhile; what belongs to another user is not ours to change.
        with contextlib.suppress(FileNotFoundError, PermissionError):
            mode = path.lstat().st_mode
            if not stat.S_ISLNK(mode) and mode & others:
                path.chmod(stat.S_IMODE(mode) & ~others)
                closed += 1
    return closed


def secret_key(folder: Path) -> str:
    """The key that signs sessions: `folder`/secret_key, made on first use and readable only by its owner.

    Processes that start at the same time get the same key: the file appears exactly once, complete.
    """
    path = folder / "secret_key"
    make_writable_folder(folder)
    if not path.exists():
        draft = folder / f".secret_key-{os.getpid()}-{secrets.token_hex(4)}"
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(64))
        try:
            os.link(draft, path)
        except FileExistsError:
            pass  # another process was first: its key is used
        finally:
            draft.unlink()
    try:
        return path.read_text().strip()
    except OSError as error:
        raise DataFolderError(
            f"{path} cannot be read ({error.strerror}): make it readable for the user that runs the server"
        ) from error
