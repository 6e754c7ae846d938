"""`frontrunner worker`: measure for a search on another host, with a command of this host's own."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from client_kit import APP
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.errors import ClientError, UsageError
from client_kit.evaluation import ReferenceDevice, serve_as
from client_kit.home import Home
from frontrunner.lease_server import device_name
from groundwork import __version__, terminal
from groundwork.command_line import USAGE_ERROR, Parser
from groundwork.folders import user_folder
from pareto.errors import EvaluationError, ParetoError
from pareto.fronts.censored import Censored
from pareto.fronts.objective import Objective
from pareto.measuring.interrupts import interruptible
from pareto.measuring.program import Program
from slam.public_text import one_line
from wire.lease import Lease, Result

IDLE_SECONDS = 0.5
INTERRUPTED = 130


@dataclass(frozen=True)
class ProgramWorker(ReferenceDevice):
    """This machine as a worker that runs `command`."""

    command: str = ""

    def measure(self, lease: Lease) -> Result | None:
        """The outcome of `lease`; None if the lease has ended."""
        objectives = tuple(Objective(name, name in lease.maximised) for name in lease.objectives)
        program = Program(
            self.command,
            lease.configuration,
            objectives,
            lease.timeout_seconds,
            lease.feasible,
            grace=lease.grace_seconds,
        )
        finished, lost = threading.Event(), threading.Event()

        def renew() -> None:
            while not finished.wait(lease.heartbeat_seconds):
                if not self.heartbeat(lease):
                    lost.set()
                    program.end()

        threading.Thread(target=renew, daemon=True).start()
        result = partial(Result, software=f"{APP} {__version__}", configuration=lease.configuration)
        try:
            measured = program.measure(dict(lease.configuration), conditions=lease.stop_above)
        except EvaluationError as error:
            if lost.is_set():
                self.console.say(f"{lease.id}: the lease is gone, the program was ended")
                return None
            self.console.say(f"{lease.id}: failed: {error}")
            return result("failed", error=one_line(str(error)))
        except KeyboardInterrupt:
            self.return_lease(lease.id)
            raise
        finally:
            finished.set()
        values, stopped_at = measured.values, measured.stopped_at
        shown = ", ".join(f"{name} {value:.6g}" for name, value in values.items())
        early = "" if stopped_at is None else f", ended early after {stopped_at} reports"
        self.console.say(f"{lease.id}: {shown}{early}")
        bounds = [name for name, value in values.items() if isinstance(value, Censored)]
        plain = {name: float(value) for name, value in values.items()}
        return result("done", values=plain, censored=bounds, stopped_at=stopped_at)


def make_parser() -> Parser:
    """The command's parser."""
    parser = Parser(prog="frontrunner worker", description="Measure for a search that serves workers.")
    parser.add_argument("url", metavar="URL", help="the address that `frontrunner tune` printed")
    parser.add_argument("--token-file", type=Path, required=True, metavar="FILE", help="holds its token")
    parser.add_argument(
        "--command", required=True, help="the search's own text; only this is run, whatever the server sends"
    )
    parser.add_argument(
        "--folder", type=Path, help="keeps a result that cannot be sent; one for each worker of a host"
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    """Measure until Ctrl-C; return the exit code."""
    options = make_parser().parse_args(arguments)
    try:
        token = options.token_file.read_text(encoding="utf-8").strip()
        home = Home(options.folder or user_folder() / "worker")
        home.prepare()
        worker = ProgramWorker(
            *(Server(options.url), device_name(options.command), token, home, Console(), time.sleep),
            command=options.command,
        )
        with interruptible():
            serve_as(worker, idle=IDLE_SECONDS)
    except KeyboardInterrupt:
        return INTERRUPTED
    except UsageError as error:
        differs = "(another_device)" in str(error)
        terminal.fail(
            "--command differs from that of the search: give the same text" if differs else str(error)
        )
    except (ClientError, ParetoError) as error:
        terminal.fail(str(error))
    except OSError as error:
        terminal.fail(f"{error.filename}: {error.strerror}")
    return USAGE_ERROR
