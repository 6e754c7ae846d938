"""An evaluation: one measurement of one configuration, as machines send it and as everybody reads it.

`Outcome` is what a machine measures. The result of a lease, the file of an exploration, the API and the
exports have its fields; a further one is one more line here, and a column of the database.
"""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Self

import msgspec

from wire.meaning import means

Text = Annotated[str, msgspec.Meta(max_length=200)]
Reason = Annotated[str, msgspec.Meta(max_length=500)]
# As databases hold them.
Count = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
SmallCount = Annotated[int, msgspec.Meta(ge=0, le=2**15 - 1)]
Moment = Annotated[datetime, msgspec.Meta(tz=True)]
Scalar = bool | int | float | str
# Seconds, metres, bytes, joules by name: never negative, and JSON has no infinite numbers.
Quantities = Annotated[
    dict[
        Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,63}$")],
        Annotated[float, msgspec.Meta(ge=0)],
    ],
    msgspec.Meta(max_length=64),
]


class Part(msgspec.Struct, frozen=True):
    """The result on one sequence: objectives (units as in a measurement) and lost frames.

    `stopped_at`: after how many frames it ended early; null if it ran to its end. Errors are then those so
    far, or less.
    """

    sequence: Text
    lost: Count
    objectives: Quantities
    stopped_at: Count | None = None

    @classmethod
    def of(cls, measured: Mapping[str, Any]) -> Self:
        """What `slam` measures and an evaluation stores: the objectives beside the other members."""
        own = cls.__struct_fields__
        objectives = {name: float(value) for name, value in measured.items() if name not in own}
        return cls(measured["sequence"], measured["lost"], objectives, measured.get("stopped_at"))

    @property
    def stored(self) -> dict[str, Any]:
        """As an evaluation stores it."""
        own = {"sequence": self.sequence, "lost": self.lost, "stopped_at": self.stopped_at}
        return own | self.objectives


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What a machine says of a measurement. Objectives: runtime in seconds a frame, ate_* in metres."""

    objectives: Annotated[
        Quantities | None, means("what is minimised: seconds a frame, metres", column=None)
    ] = None
    parts: Annotated[
        Annotated[list[Part], msgspec.Meta(max_length=1000)] | None,
        means("results by sequence, null for a single sequence", column=None),
    ] = None
    censored: Annotated[
        Annotated[list[Text], msgspec.Meta(max_length=64)],
        means("objectives that are at least this large, since it ended early", column=None),
    ] = []
    stages: Annotated[
        Quantities | None, means("mean seconds a frame by the name of the stage", column=None)
    ] = None
    software: Annotated[
        str, msgspec.Meta(max_length=64), means("name and version of the program that measured")
    ] = ""
    error: Annotated[str, msgspec.Meta(max_length=500), means("why it failed")] = ""
    device: Annotated[
        Annotated[dict[Text, Reason | float | bool | None], msgspec.Meta(max_length=32)] | None,
        means("description of the device that measured it", column=None),
    ] = None


AS_MEASURED = ("stages", "device")  # of an outcome: stored as the machine says, without any change


def as_measured(outcome: Any) -> dict[str, Any]:
    """What `outcome`, a measurement or the result of a lease, has of AS_MEASURED."""
    values = {name: getattr(outcome, name) for name in AS_MEASURED}
    return {name: value for name, value in values.items() if value is not None}


class Reference(msgspec.Struct, forbid_unknown_fields=True):
    """What the devices of one machine say of a front's point: metres, and the digest of the program."""

    trajectory: list[Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]]
    band: float
    largest_deviation: float
    variants: list[Text]
    program: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")] | None = None


class EvaluationRow(Outcome, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A measurement as everybody reads it, by the names of the database's columns.

    Its column-wise form adds a column for each parameter, objective, stage and sequence. `losses`: leases
    that ran out. `ratio_filled_at`: when the ratios to the default were added to the objectives.
    """

    number: Annotated[Count, means("order within the exploration, from 0")]
    phase: Annotated[
        str, msgspec.Meta(max_length=200), means("why it is measured; empty until it is finished")
    ]
    configuration: Annotated[dict[str, Scalar], means("values by the names of the parameters", column=None)]
    iteration: Annotated[Count, means("which time configurations were asked for, from 1", json=None)] = 0
    label: Annotated[str, means("name of the configuration, where it has one")] = ""
    state: Annotated[str, means("pending, running, done or failed")] = "done"
    attempt: Annotated[Count, means("leases so far", json=None)] = 1
    losses: SmallCount = 0
    frames: Annotated[Count | None, means("frames that are run; empty for the whole sequence", json=None)] = (
        None
    )
    perturbation: Annotated[SmallCount, means("seed by which depth was changed by one unit, 0 for none")] = 0
    ratio_filled_at: Moment | None = None
    reference: Reference | None = None
    started_at: Annotated[Moment | None, means("when a device took it", json=None)] = None
    finished_at: Annotated[Moment | None, means("when it ended; null while it runs")] = None

    @property
    def device_name(
        self,
    ) -> Annotated[str | None, means("name of the device", json=None, column="device")]:
        """The cell of its device."""
        name = (self.device or {}).get("name")
        return None if name is None else str(name)

    @property
    def censored_names(
        self,
    ) -> Annotated[
        str,
        means("names of objectives that are at least this large, with commas", json=None, column="censored"),
    ]:
        """The cell that `frontrunner tune` reads."""
        return ",".join(self.censored)
