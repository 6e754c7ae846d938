"""A convolution kernel on real GPUs, as it was measured: tables below FRONTRUNNER_DATA."""

import csv
import os
from pathlib import Path
from typing import Any

import pytest

from pareto.spaces.space import Space
from tests.builders.spaces import space_of

NAMES = (
    "block_size_x",
    "block_size_y",
    "tile_size_x",
    "tile_size_y",
    "read_only",
    "use_padding",
    "use_shmem",
)
CONSTRAINTS = [  # exactly what the tables leave out
    "block_size_x * block_size_y <= 1024",
    "use_padding == 0 or (block_size_x % 32 != 0 and use_shmem == 1)",
    "use_shmem == 0 or (block_size_x * tile_size_x + 14) * (block_size_y * tile_size_y + 14) * 4 <= 49152",
]


def measured(device: str) -> list[tuple[dict[str, Any], float | None]]:
    """Each configuration in the table of `device` with its seconds, None where it did not run."""
    if "FRONTRUNNER_DATA" not in os.environ:
        pytest.skip("FRONTRUNNER_DATA is not set: it names the folder with dse/convolution")
    path = Path(os.environ["FRONTRUNNER_DATA"]) / "dse" / "convolution" / f"convolution_{device}.csv"
    with path.open(newline="") as file:
        return [
            (
                {name: int(row[name]) for name in NAMES},
                None if row["time"].endswith("Config") else float(row["time"]),  # the name of an error
            )
            for row in csv.DictReader(file)
        ]


def space(device: str = "A100") -> Space:
    """The values in the table of `device`, with CONSTRAINTS."""
    table = [configuration for configuration, _ in measured(device)]
    values = {name: sorted({configuration[name] for configuration in table}) for name in NAMES}
    return space_of(*CONSTRAINTS, **values)
