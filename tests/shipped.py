"""What ships: a front of each application, so that tests name no version, and the sequence."""

from pathlib import Path

FIXTURES = Path(__file__).parents[1] / "fixtures"
LIVING_ROOM = FIXTURES / "sequences" / "living-room"
[KFUSION] = (FIXTURES / "fronts").glob("kfusion-*.json")
