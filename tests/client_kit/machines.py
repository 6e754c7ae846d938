"""Machines played by files below a folder that stands for the root, and by small programs on PATH."""

from pathlib import Path


def files(root: Path, contents: dict[str, str]) -> None:
    """Write each text at its path below `root`."""
    for name, text in contents.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def program(folder: Path, name: str, text: str) -> None:
    """A shell script `name` in `folder` that does `text`."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def getprop(folder: Path, properties: dict[str, str]) -> None:
    """An Android's getprop with these `properties`."""
    cases = "\n".join(f"'{key}') printf '%s\\n' '{value}';;" for key, value in properties.items())
    program(folder, "getprop", f'case "$1" in\n{cases}\n*) echo;;\nesac')
