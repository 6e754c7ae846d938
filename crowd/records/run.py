"""One configuration over the whole sequence."""

from datetime import datetime
from typing import Annotated
from uuid import UUID

from crowd.records import shared
from crowd.records.device import Device
from crowd.records.record import Record
from wire.meaning import means, shows

# Fields of a run that its session has, too.
OF_SESSION = (
    "session", "device", "application", "front", "backend", "processor", "processor_class", "started_at",
)  # fmt: skip


class RunRow(Record, frozen=True, kw_only=True):
    """A run without its frames, with columns of its session. The start is rounded down to the hour."""

    uuid: Annotated[
        UUID, means("its id, which never changes; /runs/ID/ is its page", json="id", column="run")
    ]
    session: Annotated[UUID, means("id of its session: a row of sessions")]
    device: Annotated[Device, shows(json={"device": "slug"}, column={})]
    application: Annotated[str, means("such as kfusion", column=None)]
    front: shared.Front
    configuration: shared.Configuration
    backend: Annotated[str, means("what computed, such as opencl", column=None)]
    processor: Annotated[str, means("the chip that computed, as the rules call it", column=None)]
    processor_class: Annotated[str, means("cpu or gpu", column=None)]
    started_at: Annotated[
        datetime, means("start of its session by the device's clock, to the hour", column=None)
    ]
    repeat: Annotated[int, means("which run of this configuration in the session, from 0", arrow="int32")]
    order: Annotated[int, means("place among all runs of the session, from 0", arrow="int32")]
    status: Annotated[str, means("ok or failed")]
    failure: Annotated[str, means("why the run failed; empty where it did not", column=None)]
    mean_us: Annotated[float | None, means("the run's value: arithmetic mean over the counted frames", "µs")]
    tracked_frames: Annotated[
        int | None, means("frames whose tracking succeeded; empty where unknown", arrow="int32")
    ]
    ate_max: Annotated[float | None, means("largest distance of the camera from its true place", "m")]
    ate_mean: Annotated[float | None, means("mean distance of the camera from its true place", "m")]
    ate_rmse: Annotated[float | None, means("root of the mean squared distance", "m")]
    deviation: Annotated[float | None, means("largest distance from the reference trajectory", "m")]
    cpu_us: Annotated[int | None, means("processor time over all threads and the counted frames", "µs")]
    waited_us: Annotated[
        int | None, means("its threads stood ready without a processor, over the counted frames", "µs")
    ]
    state: shared.State
    reason: shared.Reason

    @property
    def mean_seconds(self) -> float | None:
        """The mean of the counted frames, seconds."""
        return None if self.mean_us is None else self.mean_us * 1e-6

    @property
    def finished(self) -> bool:
        """Whether it did not fail. A failed run may have all frames: it lost the camera in most of them."""
        return self.status == "ok"


class Frames(Record, frozen=True, kw_only=True):
    """The frames of a run, as they are stored and shown."""

    frame_us: Annotated[
        list[int], means("wall time of the computation of each frame", "µs", arrow="list<uint32>")
    ]
    stages_us: Annotated[
        dict[str, list[int]],
        means("the same of each stage, by its name", "µs", arrow="map<string, list<uint32>>"),
    ]
    tracked: Annotated[
        list[bool | None],
        means(
            "whether tracking succeeded, null where it was not tried or the frame was left out; empty where "
            "unknown",
            arrow="list<bool>",
        ),
    ]
