"""The commands of `python -m pareto`: explore | front | plot | space | compare | transfer."""

from __future__ import annotations

import argparse
import os
import sys

from pareto.cli.arguments import Parser
from pareto.cli.compare import add_compare
from pareto.cli.explore import add_explore
from pareto.cli.front import add_front
from pareto.cli.plot import add_plot
from pareto.cli.space import add_space
from pareto.cli.transfer import add_transfer
from pareto.errors import ParetoError


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code.

    0 done, 1 nothing succeeded, 2 usage, 130 interrupted with everything saved.
    """
    try:
        options = _parser().parse_args(arguments)
        code = int(options.act(options))
        sys.stdout.flush()
        return code
    except ParetoError as error:
        sys.stderr.write(f"pareto: {error}\n")
        return 2
    except BrokenPipeError:  # | head: nobody reads on, which is nobody's error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        sys.stderr.write(f"pareto: {error.filename or 'cannot write'}: {error.strerror or error}\n")
        return 2
    except KeyboardInterrupt as interrupt:
        sys.stderr.write(f"\npareto: {interrupt or 'interrupted; the same command goes on from here'}\n")
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m pareto", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    add_explore(commands)
    add_front(commands)
    add_plot(commands)
    add_space(commands)
    add_compare(commands)
    add_transfer(commands)
    return parser
