"""The command line of `frontrunner paper`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import groundwork
from frontrunner.paper import report
from frontrunner.paper.budget import BUDGETS, DEFAULT, Budget, Study
from frontrunner.paper.crowd import Crowd, CrowdError, read_crowd
from frontrunner.paper.estimate import study_hours, surface_hours
from frontrunner.paper.exploration import (
    RUNTIME,
    Exploration,
    References,
    explore,
    measure_references,
    measured_whole,
)
from frontrunner.paper.findings import Results, findings
from frontrunner.paper.page import write_html, write_markdown
from frontrunner.paper.response import known_runs, measure_surface
from groundwork import terminal
from groundwork.command_line import USAGE_ERROR, Parser
from pareto.errors import ParetoError
from pareto.measuring.folder import Folder
from pareto.measuring.interrupts import interruptible
from slam import isolated
from slam.devices.choice import choose_device
from slam.devices.device import DeviceError, NoDeviceError
from slam.reports.surface import SurfaceError

HTML, MARKDOWN, SURFACE = "paper.html", "paper.md", "surface"
TIMES = 3  # that the default and the other references are measured: once before the search, then after it
MISTAKES = (ParetoError, SurfaceError, DeviceError, CrowdError, isolated.MeasurementError, OSError)


def make_parser(prog: str) -> Parser:
    """The parser of the command."""
    parser = Parser.of_program(
        prog, "Measure the figures and tables of Nardi et al. 2017 again, beside the paper's numbers."
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder; a second run goes on where it ended"
    )
    parser.add_argument(
        "--budget",
        choices=list(BUDGETS),
        default="small",
        help="small: about an hour (default); full: as many samples as the paper's",
    )
    parser.add_argument("--server", metavar="URL", help="a server whose crowd's speedups are drawn")
    return parser


def main(words: list[str], prog: str = "frontrunner paper") -> int:
    """Measure what the folder lacks and write the page; 0 done, 2 a mistake, 3 no device, 130 interrupted."""
    options = make_parser(prog).parse_args(words)
    try:
        with interruptible():
            crowd = read_crowd(options.server) if options.server else None
            repeat_paper(options.out, options.budget, BUDGETS[options.budget], crowd)
        return 0
    except (NoDeviceError, isolated.CannotMeasureHereError) as error:
        terminal.fail(str(error))
        return isolated.NO_DEVICE
    except MISTAKES as error:
        terminal.fail(" ".join(str(error).split()))
        return USAGE_ERROR
    except KeyboardInterrupt:
        with suppress(OSError):  # SIGHUP: the terminal was closed
            terminal.note("interrupted; every finished run is saved, and the same command goes on from here")
        return 130


def repeat_paper(out: Path, name: str, budget: Budget, crowd: Crowd | None = None) -> Results:
    """Measure what `out` lacks of `budget`, and write the page after each part of it."""
    device = choose_device(None).describe()
    machine = f"{device['name']} ({device['driver']}), version {groundwork.__version__}"
    results = Results(crowd=crowd)

    def write() -> None:
        sections = list(report.sections(results, budget, name, machine))
        write_html(out / HTML, report.TITLE, sections)
        write_markdown(out / MARKDOWN, report.TITLE, sections)

    with Folder(out).locked():
        terminal.note("measuring the defaults, to know how long the rest takes")
        defaults = {
            study.system: _references(study, out, times=1)[DEFAULT][RUNTIME]
            for study in (budget.kfusion, budget.elasticfusion)
        }
        _print_hours(budget, out, defaults)
        kfusion, references = _explored(budget.kfusion, out)
        results = replace(results, kfusion=kfusion, kfusion_references=references)
        write()
        elasticfusion, references = _explored(budget.elasticfusion, out)
        results = replace(results, elasticfusion=elasticfusion, elasticfusion_references=references)
        write()
        results = replace(results, surface=measure_surface(budget.surface, out / SURFACE))
        write()
    for finding in findings(results):
        sys.stdout.write(f"{finding.verdict.value}: {finding.figure}: {finding.here}\n")
    sys.stdout.write(f"{out / HTML} and {out / MARKDOWN}\n")
    return results


def _explored(study: Study, out: Path) -> tuple[Exploration, References]:
    terminal.note(f"exploring {study.title}: {out / study.system}")
    exploration = explore(study, out / study.system, measured_whole(study))
    return exploration, _references(study, out, TIMES)


def _references(study: Study, out: Path, times: int) -> References:
    return measure_references(study, _references_folder(study, out), measured_whole(study), times)


def _references_folder(study: Study, out: Path) -> Path:
    return out / f"{study.system}-references"


def _print_hours(budget: Budget, out: Path, defaults: Mapping[str, float]) -> None:
    """Print how long what is left takes; `defaults` are seconds a frame by system."""
    hours = {
        study.title: study_hours(
            study, out / study.system, _references_folder(study, out), defaults[study.system]
        )
        for study in (budget.kfusion, budget.elasticfusion)
    }
    measured = known_runs(out / SURFACE)
    hours["the response surface"] = surface_hours(budget.surface, measured, defaults[budget.kfusion.system])
    parts = ", ".join(f"{name} {each:.2g}" for name, each in hours.items())
    terminal.note(f"about {sum(hours.values()):.2g} hours are left on this machine: {parts}")
