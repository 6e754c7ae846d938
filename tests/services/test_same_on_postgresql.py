"""The crowd's own tests once more, on a real PostgreSQL."""

import os
import subprocess
import sys

import pytest

from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT

AGAIN = (
    "submissions",
    "bad_input",
    "erasure",
    "recomputing",
    "states",
    "fronts",
    "publishing",
    "public_api",
    "manifest",
    "unknown_members",
    "size_limits",
    "open_data",
)


def test_the_crowds_tests_pass_on_postgresql(postgresql: PostgreSQL) -> None:
    files = [f"tests/crowd/test_{name}.py" for name in AGAIN]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *files],
        cwd=ROOT,
        env=os.environ | {"DATABASE_URL": postgresql.url},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == pytest.ExitCode.OK, done.stdout[-5000:]
