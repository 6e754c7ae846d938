"""One measurement of an exploration."""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Self

import msgspec

from crowd.records.record import Record, means


class Part(msgspec.Struct):
    """The result on one sequence: objectives (units as in a measurement) and lost frames.

    `stopped_at`: after how many frames it ended early; null if it ran to its end.
    """

    sequence: str
    lost: int
    objectives: dict[str, float]
    stopped_at: int | None = None

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Self:
        """What an evaluation stores, with its objectives beside the other members."""
        own = cls.__struct_fields__
        objectives = {name: float(value) for name, value in stored.items() if name not in own}
        return cls(stored["sequence"], stored["lost"], objectives, stored.get("stopped_at"))

    @property
    def stored(self) -> dict[str, Any]:
        """As an evaluation stores it."""
        own = {"sequence": self.sequence, "lost": self.lost, "stopped_at": self.stopped_at}
        return own | self.objectives


class EvaluationRow(Record, frozen=True, kw_only=True):
    """A measurement as everybody reads it. Objectives: runtime in seconds a frame, ate_* in metres.

    Its column-wise form adds a column for each parameter, objective, stage and sequence.
    """

    number: Annotated[int, means("order within the exploration, from 0")]
    phase: Annotated[str, means("why it is measured; empty until it is finished")]
    iteration: Annotated[int, means("which time configurations were asked for, from 1", json=None)]
    label: Annotated[str, means("name of the configuration, where it has one")]
    state: Annotated[str, means("pending, running, done or failed")]
    attempt: Annotated[int, means("leases so far", json=None)]
    frames: Annotated[int | None, means("frames that are run; empty for the whole sequence", json=None)]
    configuration: Annotated[dict[str, Any], means("values by the names of the parameters", column=None)]
    objectives: Annotated[
        dict[str, float] | None, means("what is minimised: seconds a frame, metres", column=None)
    ]
    parts: Annotated[list[Part] | None, means("results by sequence, null for a single sequence", column=None)]
    perturbation: Annotated[int, means("seed by which depth was changed by one unit, 0 for none")]
    censored: Annotated[
        list[str], means("objectives that are at least this large, since it ended early", column=None)
    ]
    stages: Annotated[
        dict[str, float] | None, means("mean seconds a frame by the name of the stage", column=None)
    ]
    software: Annotated[str, means("name and version of the program that measured")]
    error: Annotated[str, means("why it failed")]
    device: Annotated[dict[str, Any] | None, means("description of the device that measured it", column=None)]
    device_name: Annotated[str | None, means("name of the device", json=None, column="device")]
    started_at: Annotated[datetime | None, means("when a device took it", json=None)]
    finished_at: Annotated[datetime | None, means("when it ended; null while it runs")]

    @property
    def censored_names(
        self,
    ) -> Annotated[
        str,
        means("names of objectives that are at least this large, with commas", json=None, column="censored"),
    ]:
        """The cell that `frontrunner tune` reads."""
        return ",".join(self.censored)
