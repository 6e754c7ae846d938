"""The sequence that ships with the project."""

from __future__ import annotations

from pathlib import Path

LIVING_ROOM = Path(__file__).resolve().parents[2] / "fixtures" / "sequences" / "living-room"
