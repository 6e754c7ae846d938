"""The README's speedup is that of the front that ships, on the clients' sequence."""

import json
import re
from pathlib import Path

from tests.shipped import KFUSION

README = Path(__file__).parents[2] / "README.md"


def test_the_speedup_of_best_is_the_shipped_front_s() -> None:
    [found] = re.findall(
        r"is ([0-9.]+) times as fast as the default \(95 % interval: ([0-9.]+) to ([0-9.]+)\)",
        README.read_text(),
    )
    front = json.loads(KFUSION.read_text())
    [best] = [point for point in front["configurations"] if point["name"] == "best"]
    times = best["predicted"]["on_sequence"]

    assert found == tuple(f"{1 / times[name]:.1f}" for name in ("runtime_ratio", "high", "low"))
