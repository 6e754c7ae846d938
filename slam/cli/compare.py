"""`compare`: reports or configurations side by side."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slam.cli.arguments import UsageError, setting, writable
from slam.cli.scenes import Commands, add_run_options, measure, merged, open_device, open_scene
from slam.definitions import complete
from slam.reports import compare, page, report


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser("compare", help="reports or configurations side by side")
    parser.add_argument(
        "items",
        nargs="+",
        metavar="ITEM",
        help='a report (.json), or settings to run, as in "mu=0.2 compute_size_ratio=2"; an empty text is '
        "the default configuration. The first is what the others are compared with",
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="draw times and errors (needs Plotly)")
    add_run_options(parser)
    parser.set_defaults(execute=_compare)


def _compare(options: argparse.Namespace) -> None:
    writable(options.html)
    if options.html:
        page.plotly()
    # Everything is read and checked before anything is measured.
    wanted = [(text, *_item(text, options)) for text in options.items]
    measured = [text for text, existing, _ in wanted if existing is None]
    sequence = open_scene(options) if measured else None
    session = open_device(options) if measured else None
    reports: dict[str, Mapping[str, Any]] = {}
    for text, existing, configuration in wanted:
        name = text.strip() or "default"
        while name in reports:  # the same configuration twice shows how measurements repeat
            name += " again"
        if sequence is not None and existing is None:
            existing = measure(options, configuration, sequence, session, f"{name}: ").to_dict()
        assert existing is not None
        reports[name] = existing
    sys.stdout.write(report.comparison(reports))
    if options.html:
        page.save(options.html, "Comparison of runs", compare.figures(reports))


def _item(text: str, options: argparse.Namespace) -> tuple[Mapping[str, Any] | None, dict[str, Any]]:
    """The report in a file, or None and the configuration to run."""
    if text.endswith(".json"):
        return report.read(Path(text)), {}
    try:
        parts = [setting(part) for part in text.split()]
    except argparse.ArgumentTypeError as error:
        raise UsageError(str(error)) from None
    return None, complete(options.system, merged(parts))
