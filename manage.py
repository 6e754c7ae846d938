#!/usr/bin/env python3
"""Django's command line for this project; `frontrunner admin` is the same."""

import sys

from crowd.__main__ import main

if __name__ == "__main__":
    sys.exit(main(sys.argv))
