"""Real recordings, which are not part of this project, where present."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("FRONTRUNNER_DATA", ""))
needs_real_data = pytest.mark.skipif(
    "FRONTRUNNER_DATA" not in os.environ, reason="FRONTRUNNER_DATA names no folder with real recordings"
)
