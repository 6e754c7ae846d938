"""Settings of servers and workers that give up the dead within seconds; TEST_EVALUATOR replaces the table."""

import os

os.environ.setdefault("FRONTRUNNER_LEASE_SECONDS", "3")

from crowd.settings import *  # noqa: F403

FRONTRUNNER_EVALUATOR = os.environ.get("TEST_EVALUATOR", "tests.services.table.measure")
# What a measurement takes, so that many a kill meets one half done.
TABLE_SECONDS = float(os.environ.get("TABLE_SECONDS", "0"))
