"""python -m pareto explore | front | plot | space | compare | transfer."""

import sys

from pareto.cli.commands import main

if __name__ == "__main__":
    sys.exit(main())
