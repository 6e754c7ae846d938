"""Writes the front of an exploration as a file."""

import json
from pathlib import Path

from django.core.management.base import CommandError

from crowd.explorations.models import Exploration
from crowd.explorations.outcomes import publishing
from crowd.fronts import sequences
from crowd.fronts.content import front_file


def parse_front_name(path: Path) -> tuple[str, str]:
    """Application and version from PATH, the file of a front. Raises CommandError."""
    application, _, version = path.stem.rpartition("-")
    if not application or not version or path.suffix != ".json":
        raise CommandError(f"{path}: name it <application>-<version>.json")
    if not path.parent.is_dir():
        raise CommandError(f"{path}: there is no folder {path.parent}")
    return application, version


def write_front(exploration: Exploration, path: Path) -> str:
    """Write the front of EXPLORATION to PATH. Returns a line about it. Raises CommandError."""
    application, version = parse_front_name(path)
    if application != exploration.application:
        raise CommandError(f"{path}: name it {exploration.application}-<version>.json")
    try:
        document = publishing.front_document(exploration, version)
        front_file.check(document)
    except (publishing.NothingToPublishError, front_file.InvalidFrontError, sequences.SequenceError) as error:
        raise CommandError(f"{exploration}: {error}") from error
    write(path, json.dumps(document, indent=2) + "\n")
    return f"{len(document['configurations'])} points: {path}"


def write(path: Path, text: str) -> None:
    """Write TEXT to PATH. Raises CommandError if that fails."""
    try:
        path.write_text(text)
    except OSError as error:
        raise CommandError(f"{path} cannot be written: {error.strerror}") from error
