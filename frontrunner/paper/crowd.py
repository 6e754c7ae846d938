"""The bars of a server's crowd: the speedup of each device over the default on that device."""

from __future__ import annotations

import json
import urllib.parse
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SECONDS = 30.0  # for an answer


class CrowdError(RuntimeError):
    """A server whose crowd cannot be read."""


@dataclass(frozen=True)
class Bar:
    """A speedup on a device: its interval where there is one, whether it is confirmed or simulated."""

    device: str
    label: str
    speedup: float
    low: float | None
    high: float | None
    confirmed: bool
    simulated: bool

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Bar:
        """A row of `/speedups`."""
        name = " ".join(filter(None, (row["manufacturer"], row["name"])))
        return cls(
            row["device"],
            f"{name} ({row['backend']}, {row['processor']})",
            float(row["speedup"]),
            row["low"],
            row["high"],
            row["state"] == "confirmed",
            bool(row["simulated"]),
        )


@dataclass(frozen=True)
class Crowd:
    """The bars of a server, fastest first; figures of suspect sessions alone are not among them."""

    server: str
    front: str | None
    bars: tuple[Bar, ...]

    @property
    def devices(self) -> int:
        """The number of device models."""
        return len({bar.device for bar in self.bars})

    @property
    def simulated(self) -> bool:
        """Whether any device is simulated, as on a demo server."""
        return any(bar.simulated for bar in self.bars)


def read_crowd(server: str) -> Crowd:
    """Ask a server for the speedups of all its devices. Raises CrowdError where it does not answer as one."""
    address: str | None = f"{server.rstrip('/')}/api/v1/speedups?suspect=0&limit=1000"
    rows: list[dict[str, Any]] = []
    front = None
    try:
        while address:
            page = _answer(address)
            front = page["front"]
            rows += page["results"]
            address = page["next"] and urllib.parse.urljoin(address, page["next"])
        return Crowd(server, front, tuple(map(Bar.of, rows)))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CrowdError(
            f"--server {server} does not answer like a server of Frontrunner ({error}): give the address of "
            "its home page"
        ) from error


def _answer(address: str) -> Any:
    if urllib.parse.urlsplit(address).scheme not in ("http", "https"):
        raise ValueError("the address must begin with http:// or https://")
    with urllib.request.urlopen(address, timeout=SECONDS) as answer:
        return json.load(answer)
