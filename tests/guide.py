"""The guide as `make docs` builds it: every warning is an error."""

import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[1]
STRICT = ("--nitpicky", "--fail-on-warning", "--keep-going", "--quiet")


def build(folder: Path) -> Path:
    """The guide's pages, made in `folder`."""
    pages, doctrees = folder / "guide", folder / "doctrees"
    command = [sys.executable, "-m", "sphinx", *STRICT, "--doctree-dir", doctrees, PROJECT / "docs", pages]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return pages
