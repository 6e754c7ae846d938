"""python -m pareto explore | front | plot | space | compare | transfer."""

import sys

try:
    from pareto.cli.commands import main
except ModuleNotFoundError as missing:
    package = (missing.name or "").split(".")[0]
    if package == "pareto":
        raise
    sys.stderr.write(f"pareto: searching needs {package}: pip install 'frontrunner[explore]'\n")
    sys.exit(2)
except KeyboardInterrupt:  # while the packages are being read, which takes a second
    sys.stderr.write("\npareto: interrupted before it began\n")
    sys.exit(130)

if __name__ == "__main__":
    sys.exit(main())
