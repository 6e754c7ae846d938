"""A device model with what was measured on it."""

from datetime import datetime
from typing import Annotated

from crowd.records.device import Device
from crowd.records.record import Record
from crowd.records.speedup import Speedup
from wire.meaning import means, shows

NAMES = ("manufacturer", "name", "cpu", "soc", "gpu", "os")


class DeviceRow(Record, frozen=True, kw_only=True):
    """A device in a list. `speedup` is that of `best` on the newest measured front, None without one.

    With several backends and processors, it is that of the preferred one.
    """

    device: Annotated[
        Device,
        shows(
            json={name: name for name in ("slug", *NAMES, "simulated", "masked")},
            column={"device": "slug"} | {name: name for name in (*NAMES, "masked")},
        ),
    ]
    sessions: Annotated[int, means("sessions measured on it")]
    installations: Annotated[int, means("installations that measured on it")]
    last_session_at: Annotated[
        datetime | None, means("start of the newest session, to the hour", column=None)
    ]
    speedup: Speedup | None
