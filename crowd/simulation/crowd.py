"""A simulated crowd: its devices enrol, measure the front and probes, and submit all that."""

import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from typing import Any

import numpy as np
from django.db import transaction

from crowd.results.models import MeasurementSession
from crowd.simulation.devices import (
    MAX_INSTALLATIONS,
    devices,
    read_configurations,
)
from crowd.simulation.sessions import session
from crowd.simulation.transport import Transport

APP = "demo"
DAYS = 90  # over which the sessions are spread
SESSIONS = 5  # of each device
PROBING = 83  # devices that are asked for probes: the answers take long, and more hardly change the pages
PROBING_SHARE = 0.5  # of their installations have time for probes
PROBE_MINUTES = 2  # for a session of probes
PROBE_PAUSE = timedelta(hours=1)  # before a session of probes


@dataclass(frozen=True)
class Progress:
    """The numbers of devices and sessions sent, and of runs accepted."""

    devices: int
    sessions: int
    runs: int


@dataclass(frozen=True)
class _Installed:
    """An installation: its number among its device's, and its newest session's release and start."""

    number: int
    token: str
    release: int
    started_at: datetime


class Crowd:
    """`count` devices that measure the published front of `application`, in `sessions` sessions each.

    The same `seed` on the same front makes the same, on another front other sessions of the same devices.
    What is sent as probes depends on what the server asks for, too. Raises RefusedError without a front.
    """

    def __init__(
        self,
        transport: Transport,
        count: int,
        seed: int,
        today: datetime,
        sessions: int = SESSIONS,
        application: str = "kfusion",
    ) -> None:
        self.transport, self.seed, self.sessions = transport, seed, sessions
        self.midnight = datetime.combine(today.date(), time.min, UTC)
        self.path = f"/manifest?application={application}"
        self.manifest = transport.ask(200, "GET", self.path)
        front = transport.ask(200, "GET", f"/fronts/{self.manifest['front_version']}")
        self.front = read_configurations(front)
        self.devices = devices(count, self.front, seed)
        self._installed: dict[int, list[_Installed]] = {}

    def has_sent(self, place: int) -> bool:
        """Whether the device at `place` was sent already."""
        first = next(self._sessions(place))
        return MeasurementSession.objects.filter(uuid=first.document["id"]).exists()

    def send(self) -> Iterator[Progress]:
        """Enrol the devices that were not sent yet, and submit their sessions.

        A device is sent as a whole or not at all. Yields the progress after each. Raises RefusedError.
        """
        done, runs = 0, 0
        for place in range(len(self.devices)):
            if not self.has_sent(place):
                with transaction.atomic():
                    runs += self._send_device(place)
                done += self.sessions
            yield Progress(place + 1, done, runs)

    def send_probes(self, share: float = PROBING_SHARE) -> Iterator[Progress]:
        """Let a `share` (0 to 1) of the installations of the first devices request probes and submit them.

        Yields the progress after each device. Raises RefusedError.
        """
        done, runs = 0, 0
        for place, installed in list(self._installed.items())[:PROBING]:
            random = self._random(place, 3)
            for each in installed:
                if random.random() >= share:
                    continue
                asked = self.transport.ask(
                    200, "GET", f"{self.path}&minutes={PROBE_MINUTES}", token=each.token
                )
                if asked["assigned"]:
                    when = each.started_at + PROBE_PAUSE
                    document = session(
                        self.devices[place], each.number, each.release, self.front, asked, False, when, random
                    )
                    runs += self._submit(place, each.token, _Sent(each.number, each.release, when, document))
                    done += 1
            yield Progress(place + 1, done, runs)

    def submission(self, place: int, sent: "_Sent") -> dict[str, Any]:
        """The submission of `sent` by the device at `place`."""
        device = self.devices[place]
        return {
            "schema_version": 1,
            **_versions(self.manifest),
            "device": device.description(sent.installation, sent.release),
            "show_model": device.shows_model,
            "sessions": [sent.document],
        }

    def _send_device(self, place: int) -> int:
        """Send the device at `place`. Returns how many of its runs were accepted."""
        count = min(self.devices[place].installations, self.sessions)
        tokens = [self._enrol(place, number) for number in range(count)]
        runs, newest = 0, {}
        for sent in self._sessions(place):
            token = tokens[sent.installation]
            runs += self._submit(place, token, sent)
            newest[sent.installation] = _Installed(sent.installation, token, sent.release, sent.started_at)
        self._installed[place] = list(newest.values())
        return runs

    def _sessions(self, place: int) -> Iterator["_Sent"]:
        """The sessions of a device over the days before today, oldest first, with ever newer drivers."""
        device, random, count = self.devices[place], self._random(place, 1), self.sessions
        ages = np.sort(random.uniform(0.0, DAYS, count))[::-1]
        for number, age in enumerate(ages):
            release = number * len(device.descriptions) // count
            installation = number % min(device.installations, count)
            when = self.midnight - timedelta(days=float(age))
            document = session(
                device, installation, release, self.front, self.manifest, device.thorough, when, random
            )
            yield _Sent(installation, release, when, document)

    def _enrol(self, place: int, number: int) -> str:
        document = {"app": APP, **_versions(self.manifest)}
        address = _address(place, number)
        token: str = self.transport.ask(201, "POST", "/enrol", document=document, address=address)["token"]
        return token

    def _submit(self, place: int, token: str, sent: "_Sent") -> int:
        """Submit `sent`. Returns how many runs the server accepted."""
        response = self.transport.ask(
            202,
            "POST",
            "/submissions",
            document=self.submission(place, sent),
            token=token,
            address=_address(place, sent.installation),
            HTTP_IDEMPOTENCY_KEY=str(uuid.uuid4()),
        )
        return sum(item["status"] == "accepted" for item in response["items"])

    def _random(self, place: int, purpose: int) -> np.random.Generator:
        slug = self.manifest["front_version"].encode()
        return np.random.default_rng((self.seed, place + 1, purpose, *slug))


@dataclass(frozen=True)
class _Sent:
    installation: int
    release: int
    started_at: datetime
    document: dict[str, Any]


def _address(place: int, installation: int) -> str:
    """The address of an installation, each in a network of its own."""
    number = place * MAX_INSTALLATIONS + installation
    return f"fd00:{number >> 16:x}:{number & 0xFFFF:x}::1"


def _versions(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "app_version": manifest["minimum_app_version"],
        "consent_version": manifest["consent_version"],
    }
