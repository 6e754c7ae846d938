"""What an export of the open data writes: python -m tests.benchmarks.crowd_exports RUNS.

Fills a database of its own with simulated runs of 50 devices (`crowd_filling`). Prints the bytes that each
of four exports writes: the first, one of an unchanged crowd, one after a run's state changed, and one of 40
more runs.
"""

import os
import sys
import tempfile
from collections import Counter
from pathlib import Path
from unittest import mock

import django

from tests.services.intake import prepare

DEVICES, NEW_RUNS = 50, 40


def main(runs: int) -> None:
    """Print a row of a Markdown table for each export."""
    with tempfile.TemporaryDirectory(prefix="frontrunner-exports-") as folder:
        prepare(Path(folder), {})
        os.environ |= {"FRONTRUNNER_VAR": folder, "FRONTRUNNER_RARE_BELOW": "1"}
        os.environ["DJANGO_SETTINGS_MODULE"] = "crowd.settings"
        django.setup()
        _print_table(runs)


def _print_table(runs: int) -> None:
    from crowd.results.models import Run

    print("| export | runs, MB | other files, MB |\n|---|---|---|")
    _add(runs, seed=0)
    _print_row("first")
    _print_row("unchanged crowd")
    Run.objects.filter(pk=Run.objects.earliest("pk").pk).update(state="quarantined", reason="decision")
    _print_row("another state of a run")
    _add(NEW_RUNS, seed=1)
    _print_row(f"{NEW_RUNS} more runs")


def _add(runs: int, seed: int) -> None:
    from crowd.results.figures import sessions
    from tests.benchmarks.crowd_filling import fill

    fill(runs, DEVICES, seed)
    while sessions.summarise_waiting(2_000):
        pass
    sessions.refresh_stale()


def _print_row(name: str) -> None:
    from crowd.results.models import ExportFile
    from crowd.results.opendata import description_files, exports, storing, writing

    written: Counter[str] = Counter()

    def counting(path: Path, name: str, table: str, format: str) -> ExportFile:
        written[table] += path.stat().st_size
        return storing.describe(path, name, table, format)

    with (
        mock.patch.object(writing, "describe", counting),
        mock.patch.object(description_files, "describe", counting),
    ):
        exports.create_export()
    others = written.total() - written["runs"]
    print(f"| {name} | {written['runs'] / 1e6:.2f} | {others / 1e6:.2f} |")


if __name__ == "__main__":
    main(int(sys.argv[1]))
