"""A participant whose times follow from the reference's stages and the device's own costs. Made up."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.builders.documents import device_document, run_document, session_document, submission_document
from tests.builders.participant import Participant

# Costs with which the published best is the fastest point: what integrates less often gains nothing.
BEST_IS_BEST = {"integration": 0.1}
DEFAULT_SECONDS = 0.01  # of a frame on the reference device
MALI, ADRENO = "Mali-G715", "QUALCOMM Adreno(TM) 740"


@dataclass
class Measured:
    """`costs`: how many times dearer each stage is than on the reference device, 2 where it is not named; so
    is what lies between the stages.
    """

    participant: Participant
    front: Mapping[str, Any]
    device: str
    chip: str
    costs: Mapping[str, float] = field(default_factory=dict)
    probes: Sequence[str] = ()
    slower_at_the_end: float = 1.0

    def stages(self, configuration: str) -> dict[str, float]:
        """Seconds a frame."""
        times: Mapping[str, float] = self._reference(configuration)["stages"]
        return {stage: time * DEFAULT_SECONDS * self.costs.get(stage, 2.0) for stage, time in times.items()}

    def seconds(self, configuration: str) -> float:
        """Of a frame."""
        reference = self._reference(configuration)
        between = max(reference["runtime_ratio"] - sum(reference["stages"].values()), 0.0) * DEFAULT_SECONDS
        return sum(self.stages(configuration).values()) + 2.0 * between

    def log_ratio(self, configuration: str) -> float:
        return math.log(self.seconds("default") / self.seconds(configuration))

    def send(self) -> None:
        """A session of default and best and, where there are any, one of the probes."""
        self.submit(["default", "best", "best", "default"] * 2)
        if self.probes:
            self.submit_probes(self.probes)

    def submit_probes(self, names: Sequence[str]) -> None:
        forwards = ["default", *names]
        self.submit([*forwards, *reversed(forwards)])

    def submit(self, order: Sequence[str]) -> None:
        runs = [self._run(name, list(order[:place]).count(name), place) for place, name in enumerate(order)]
        if self.slower_at_the_end != 1.0:
            for run in runs[len(runs) // 2 :]:
                run["frame_us"] = [round(time * self.slower_at_the_end) for time in run["frame_us"]]
        session = session_document(self.front_version, runs=runs)
        described = device_document(self.device, opencl_device=self.chip)
        answer = self.participant.submit(submission_document(session, device=described))
        assert answer.status_code == 202, answer.content
        assert {item["status"] for item in answer.json()["items"]} == {"accepted"}, answer.content

    @property
    def front_version(self) -> str:
        return f"{self.front['application']}-{self.front['version']}"

    def _reference(self, configuration: str) -> Mapping[str, Any]:
        points = [*self.front["configurations"], *self.front["probes"]]
        return next(one["predicted"]["on_sequence"] for one in points if one["name"] == configuration)

    def _run(self, name: str, repeat: int, order: int) -> dict[str, Any]:
        frame_us = round(1e6 * self.seconds(name))
        stages = {stage: [round(1e6 * time)] * 100 for stage, time in self.stages(name).items()}
        return run_document(name, repeat, order, frame_us, stages_us=stages)
