"""The crowd's own tests once more, on a real PostgreSQL."""

import os
import subprocess
import sys

import pytest

from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT

# Those whose answers rest on what the database does: locks, keys, conflicts, types, order, triggers.
AGAIN = (
    "crowd/test_submissions.py",
    "crowd/test_bad_input.py",
    "crowd/test_prepared.py",
    "crowd/test_erasure.py",
    "crowd/test_races.py",
    "crowd/test_recomputing.py",
    "crowd/test_states.py",
    "crowd/test_fronts.py",
    "crowd/test_publishing.py",
    "crowd/test_front_migrations.py",
    "crowd/test_prepared_fronts.py",
    "crowd/test_session_protocol.py",
    "crowd/test_public_api.py",
    "crowd/test_session_lists.py",
    "crowd/test_unknown_members.py",
    "crowd/test_open_data.py",
    "crowd/test_open_data_erasure.py",
    "crowd/test_open_data_migration.py",
    "crowd/test_admin_erasure.py",
    "crowd/test_disclosure.py",
    "crowd/test_shown_models.py",
    "crowd/test_aliases.py",
    "predictions/test_maps.py",
    "predictions/test_assigning.py",
    "explorations/outcomes/test_results_cache.py",
    "explorations/preparing/test_preparation.py",
    "explorations/test_several_sequences.py",
    "explorations/measuring/test_leases_of_several.py",
)


def test_the_crowds_tests_pass_on_postgresql(postgresql: PostgreSQL) -> None:
    files = [f"tests/{name}" for name in AGAIN]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n0", *files],
        cwd=ROOT,
        env=os.environ | {"DATABASE_URL": postgresql.url},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == pytest.ExitCode.OK, done.stdout[-5000:]
