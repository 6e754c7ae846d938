"""The project's wheel, built from the tracked files alone and without an index."""

import shutil
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[1]
PACKAGES = ("frontrunner", "slam", "pareto", "client_kit", "crowd", "wire", "groundwork", "fixtures")
OFFLINE = ("--quiet", "--disable-pip-version-check", "--no-index", "--no-deps")


def build(folder: Path, guide: Path) -> Path:
    """The wheel with `guide`, made in `folder`: a build inside the checkout would leave its files there."""
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(PROJECT / name, source)
    for name in PACKAGES:
        shutil.copytree(PROJECT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    # One that the developer built may be older than the pages.
    shutil.rmtree(source / "frontrunner" / "guide", ignore_errors=True)
    shutil.copytree(guide, source / "frontrunner" / "guide")
    command = [sys.executable, "-m", "pip", "wheel", *OFFLINE, "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(source)], check=True)
    [wheel] = folder.glob("frontrunner-*.whl")
    return wheel
