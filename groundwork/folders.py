"""Where files lie: what ships with the project, what belongs to this user, what a server writes."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTALLED = ROOT / "frontrunner" / "fixtures"
# Of a checkout, or inside the installed package.
FIXTURES = INSTALLED if INSTALLED.is_dir() else ROOT / "fixtures"
SEQUENCES = FIXTURES / "sequences"
# Built by `make docs`, never committed; a wheel has it where it was built before.
GUIDE = ROOT / "frontrunner" / "guide"


def user_folder(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> Path:
    """The folder named by FRONTRUNNER_HOME, else `frontrunner` in the platform's data folder."""
    chosen = environment.get("FRONTRUNNER_HOME")
    if chosen:
        return Path(chosen).expanduser()
    if platform == "win32":
        base = environment.get("LOCALAPPDATA")
        return (Path(base) if base else Path.home() / "AppData" / "Local") / "frontrunner"
    if platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "frontrunner"
    base = environment.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "frontrunner"


def data_folder() -> Path:
    """The folder that FRONTRUNNER_VAR names, else `var` of the checkout, else one in the user's folder."""
    chosen = os.environ.get("FRONTRUNNER_VAR")
    if chosen:
        return Path(chosen).absolute()
    return user_folder() / "server" if INSTALLED.is_dir() else ROOT / "var"
