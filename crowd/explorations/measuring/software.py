"""The version of this software."""

import subprocess
from functools import cache
from pathlib import Path

from django.conf import settings

from groundwork import __version__


@cache
def software_version() -> str:
    """The release; in a checkout with the commit, and a mark if files differ from it."""
    base = Path(settings.BASE_DIR)
    if not (base / ".git").exists():
        return __version__
    described = _git(base, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    return f"{__version__}+{described}" if described else __version__


def _git(base: Path, *arguments: str) -> str:
    try:
        answer = subprocess.run(
            ["git", "-c", f"safe.directory={base}", *arguments],
            cwd=base,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return answer.stdout.strip()
