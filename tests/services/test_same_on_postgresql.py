"""The crowd's own tests once more, on a real PostgreSQL."""

import os
import subprocess
import sys

import pytest

from tests.services.program import ROOT

# Those whose answers rest on what the database does: locks, keys, conflicts, types, order, triggers.
AGAIN = (
    "crowd/intake/test_submissions.py",
    "crowd/intake/test_bad_input.py",
    "crowd/operations/test_prepared.py",
    "crowd/privacy/test_erasure.py",
    "crowd/operations/test_races.py",
    "crowd/figures/test_recomputing.py",
    "crowd/fronts/test_fronts.py",
    "crowd/fronts/test_publishing.py",
    "crowd/reading/test_public_api.py",
    "crowd/reading/test_session_lists.py",
    "crowd/opendata/test_open_data.py",
    "crowd/opendata/test_open_data_erasure.py",
    "crowd/opendata/test_run_parts.py",
    "crowd/operations/test_unprepared.py",
    "crowd/privacy/test_admin_erasure.py",
    "crowd/devices/test_disclosure.py",
    "crowd/devices/test_shown_models.py",
    "crowd/devices/test_aliases.py",
    "predictions/test_maps.py",
    "predictions/test_assigning.py",
    "explorations/outcomes/test_results_cache.py",
    "explorations/preparing/test_preparation.py",
    "explorations/test_several_sequences.py",
    "explorations/measuring/test_leases_of_several.py",
)

# What is tried in a folder and in a bucket differs in files alone.
ONCE = ("-m", "not exhaustive", "-k", "not bucket")


def test_the_crowds_tests_pass_on_postgresql(empty_database: str) -> None:
    files = [f"tests/{name}" for name in AGAIN]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n0", *ONCE, *files],
        cwd=ROOT,
        env=os.environ | {"DATABASE_URL": empty_database},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == pytest.ExitCode.OK, done.stdout[-5000:]
