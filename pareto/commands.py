"""The commands of `python -m pareto`: explore | front | plot | space | compare | transfer."""

from __future__ import annotations

import argparse
import os
import sys

from pareto.arguments import Parser
from pareto.compare_command import add_compare
from pareto.errors import ParetoError
from pareto.explore_command import add_explore
from pareto.front_command import add_front
from pareto.plot_command import add_plot
from pareto.space_command import add_space
from pareto.transfer_command import add_transfer


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
