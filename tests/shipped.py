"""The fronts that ship, one of each application: tests name no version."""

from pathlib import Path

FIXTURES = Path(__file__).parents[1] / "fixtures"
[KFUSION] = (FIXTURES / "fronts").glob("kfusion-*.json")
