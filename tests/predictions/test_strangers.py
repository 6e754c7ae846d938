"""One stranger against the recommendations, through the API: what one network sends moves no figure far.

Three networks each measured three models, and the probes that they were asked for.
"""

import math
import secrets
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest
from django.test import Client

from crowd.devices.services import enrol
from crowd.predictions import maps
from crowd.predictions.models import ProbeAssignment
from crowd.results import tasks
from tests.builders.measured import ADRENO, DEFAULT_SECONDS, MALI, Measured
from tests.builders.participant import API, Participant

POWERVR = "PowerVR B-Series BXM-8-256"
# Known models, with their chips and what the stages cost there.
CROWD: tuple[tuple[str, str, Mapping[str, float]], ...] = (
    ("Pixel 8", MALI, {"raycasting": 4.4, "tracking": 1.0}),
    ("Pixel 4", ADRENO, {"tracking": 4.0}),
    ("Pixel 10", POWERVR, {"integration": 0.5}),
)
MODELS = {"": "", "?gpu=Mali-G715": MALI, "?gpu=Adreno+740": ADRENO, "?gpu=PowerVR+BXM-8-256": POWERVR}
# Any device, each chip of the crowd, one without measurements, and a device.
QUESTIONS = (*MODELS, "?gpu=Adreno+650", "?model=google-pixel-8")
NETWORKS = 3
# A session that differs more from those of its model is an outlier, and one that differs more from the known
# speedups is not plausible.
USUAL, PLAUSIBLE = 1.59, 3.9
CONFIRMED_BY_CHIP = 1.1  # times the speedup of the chip
MOST_WIDENED = 1.5  # times


@dataclass
class Forged(Measured):
    """A session in which each configuration is `times` as fast as on the reference device, at any pace."""

    times: float = 1.0
    pace: float = 100.0
    stage: str = "raycasting"
    configurations: tuple[str, ...] = ()

    def seconds(self, configuration: str) -> float:
        if configuration == "default":
            return DEFAULT_SECONDS * self.pace
        ratio = 1 / self._reference(configuration)["runtime_ratio"]
        return DEFAULT_SECONDS * self.pace / (ratio * self.times)

    def stages(self, configuration: str) -> dict[str, float]:
        """All of the time in one stage."""
        return {self.stage: self.seconds(configuration)}

    def send(self) -> None:
        self.submit(["default", "best", "best", "default"] * 2)
        if self.configurations:
            self.submit_probes(self.configurations)


@dataclass
class Stranger:
    """Enrols as often as it likes, always from one network."""

    client: Client
    front: Mapping[str, Any]
    network: str = field(default_factory=lambda: secrets.token_hex(16))

    def send(self, model: str, chip: str, times: float, **changes: Any) -> None:
        """A forged session, and one of all other points and some unassigned probes."""
        changes = {"configurations": ("front-01", "front-08", "knee", "probe-02", "probe-09")} | changes
        Forged(self.participant(), self.front, model, chip, times=times, **changes).send()

    def honest_times(self, model: str) -> float:
        """How many times as fast `best` is on `model` as on the reference device."""
        [(chip, costs)] = [(chip, costs) for name, chip, costs in CROWD if name == model]
        honest = Measured(self.participant(), self.front, model, chip, costs)
        reference = Measured(self.participant(), self.front, model, chip)
        return math.exp(honest.log_ratio("best") - reference.log_ratio("best"))

    def participant(self) -> Participant:
        installation, token = enrol("client_kit", "0.1.0", 1, network=self.network)
        return Participant(self.client, token, str(installation.pk))


@pytest.fixture
def honest(measured: Any, settings: Any) -> list[Measured]:
    """The honest crowd, with its nightly maps; everybody measured the probes that were assigned."""
    settings.FRONTRUNNER_QUORUM = NETWORKS
    crowd = []
    for number in range(NETWORKS):
        for model, chip, costs in CROWD:
            varied = {stage: cost * (0.98 + 0.02 * number) for stage, cost in costs.items()}
            crowd.append(measured(model, chip, costs=varied))
    settle()
    for device in crowd:
        device.submit_probes([one["name"] for one in manifest(device)["assigned"]])
    settle()
    return crowd


@pytest.fixture
def stranger(client: Client, document: dict[str, Any]) -> Stranger:
    return Stranger(client, document)


def settle() -> None:
    """What workers do until the next morning."""
    tasks.sweep()
    maps.rebuild()


def manifest(device: Measured) -> Any:
    answer = device.participant.get("/manifest?minutes=2")
    assert answer.status_code == 200, answer.content
    return answer.json()


def assigned(devices: Iterable[Measured]) -> list[list[str]]:
    """What `devices` would be asked to measure; it stays unassigned."""
    earlier = set(ProbeAssignment.objects.values_list("pk", flat=True))
    names = [[one["name"] for one in manifest(device)["assigned"]] for device in devices]
    ProbeAssignment.objects.exclude(pk__in=earlier).delete()
    return names


def answers(client: Client) -> dict[str, Any]:
    """The public recommendations by QUESTIONS."""
    answered = {}
    for question in QUESTIONS:
        answer = client.get(f"{API}/recommendation{question}")
        assert answer.status_code == 200, answer.content
        answered[question] = answer.json()
    return answered


def moved(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[tuple[str, str], float]:
    """The shift of each figure, as part of the width of its interval before: logarithms."""
    shifts = {}
    for question, answer in before.items():
        rows = {row["configuration"]: row for row in after[question]["front"]}
        for row in answer["front"]:
            if row["configuration"] != "default":
                shift = math.log(rows[row["configuration"]]["ratio"] / row["ratio"])
                shifts[question, row["configuration"]] = abs(shift) / math.log(row["high"] / row["low"])
    return shifts


def widened(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[tuple[str, str], float]:
    """How many times as wide each interval is as it was."""
    widths = {}
    for question, answer in before.items():
        rows = {row["configuration"]: row for row in after[question]["front"]}
        for row in answer["front"]:
            if row["configuration"] != "default":
                now = rows[row["configuration"]]
                widths[question, row["configuration"]] = math.log(now["high"] / now["low"]) / math.log(
                    row["high"] / row["low"]
                )
    return widths


def chosen(answered: Mapping[str, Any]) -> dict[str, str]:
    return {question: answer["configuration"] for question, answer in answered.items()}


def on_a_chip_that_nobody_measured(stranger: Stranger) -> None:
    """One POST."""
    stranger.send("Pixel 5", "QUALCOMM Adreno(TM) 650", 1 / PLAUSIBLE, configurations=())


def with_invented_models(stranger: Stranger) -> None:
    for number in range(2):
        for chip in (MALI, ADRENO, POWERVR):
            stranger.send(f"Mallory {number}", chip, PLAUSIBLE if number % 2 else 1 / PLAUSIBLE)


def with_other_models_of_the_chips(stranger: Stranger) -> None:
    for number, chip in enumerate((MALI, ADRENO, POWERVR)):
        stranger.send(f"Pixel {number + 5}", chip, PLAUSIBLE)


def on_the_measured_models(stranger: Stranger) -> None:
    """As far from the honest as a session may be; and on another model that the chip confirms."""
    for (model, chip, _), factor in zip(CROWD, (USUAL, 1 / USUAL, USUAL), strict=True):
        stranger.send(model, chip, factor * stranger.honest_times(model), stage="tracking")
    stranger.send("Pixel 8 Pro", MALI, CONFIRMED_BY_CHIP * stranger.honest_times("Pixel 8"))


# The last makes a fourth network on each model: it may change figures, by less than their intervals' widths.
ATTACKS: tuple[Callable[[Stranger], None], ...] = (
    on_a_chip_that_nobody_measured,
    with_invented_models,
    with_other_models_of_the_chips,
    on_the_measured_models,
)


@pytest.mark.slow
def test_one_network_moves_no_figure_by_the_width_of_its_interval(
    client: Client, honest: list[Measured], stranger: Stranger
) -> None:
    before, probes = answers(client), assigned(honest)
    seconds = before["?model=google-pixel-8"]["default_seconds"]

    for attack in ATTACKS:
        attack(stranger)
        settle()

        after = answers(client)
        assert chosen(after) == chosen(before), attack
        assert max(moved(before, after).values()) < 1, attack
        assert max(widened(before, after).values()) < MOST_WIDENED, attack
        assert after["?model=google-pixel-8"]["default_seconds"] == pytest.approx(seconds, rel=0.05), attack
        if attack is not on_the_measured_models:
            assert after == before, attack
            assert assigned(honest) == probes, attack
