"""What ships with the project: `fixtures/` of a checkout, or its copy inside the installed package."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTALLED = ROOT / "frontrunner" / "fixtures"
FIXTURES = INSTALLED if INSTALLED.is_dir() else ROOT / "fixtures"
SEQUENCES = FIXTURES / "sequences"
