"""Sending made-up sessions through the real API: in this process, or to a server elsewhere."""

import gzip
import io
import json
import logging
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from typing import Any, Protocol

import numpy as np
from django.conf import settings
from django.core.handlers.wsgi import WSGIHandler

from crowd.results.simulation.devices import Configuration, SimulatedDevice, configurations_of, devices
from crowd.results.simulation.sessions import session

APP = "simulate_crowd"
API = "/api/v1"
DAYS = 90  # over which the sessions lie
WHOLE_FRONT = 0.3  # of the devices measure every configuration, in their first session of each release
MINUTES = 2  # that an installation has for a session of probes
PAUSE = timedelta(hours=1)  # before it
TIMEOUT_SECONDS = 60


class RefusedError(Exception):
    """The server did not take it; the message says what it answered."""


@dataclass(frozen=True)
class Answer:
    """A status with the body that came with it."""

    status: int
    content: Any


class Transport(Protocol):
    """Something that carries one request of the API."""

    def __call__(self, method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Answer:
        """What the server answers; raises RefusedError where none is reached."""


@dataclass(frozen=True)
class Progress:
    """How far it is: devices and sessions that are in, runs that the server took."""

    devices: int
    sessions: int
    runs: int


def in_process() -> Transport:
    """A transport to the application in this process, as its server would ask it; no server need run."""
    application = WSGIHandler()

    def carry(method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Answer:
        status: list[str] = []
        where, _, query = path.partition("?")
        environment = {
            "REQUEST_METHOD": method, "PATH_INFO": where, "QUERY_STRING": query, "SERVER_NAME": _own_host(),
            "SERVER_PORT": "443", "SERVER_PROTOCOL": "HTTP/1.1", "REMOTE_ADDR": "127.0.0.1",
            "CONTENT_TYPE": "application/json", "CONTENT_LENGTH": str(len(body)), "wsgi.version": (1, 0),
            "wsgi.url_scheme": "https", "wsgi.input": io.BytesIO(body), "wsgi.errors": io.StringIO(),
            "wsgi.multithread": False, "wsgi.multiprocess": True, "wsgi.run_once": False,
            **{f"HTTP_{name.upper().replace('-', '_')}": value for name, value in headers.items()},
        }  # fmt: skip

        def start_response(line: str, *_: object) -> Callable[[bytes], object]:
            status.append(line)
            return io.BytesIO().write

        response = application(environment, start_response)
        content = b"".join(response)
        response.close()
        return Answer(int(status[0].split()[0]), _content(content))

    return carry


def over_http(server: str) -> Transport:
    """A transport to the SERVER at an address such as https://host."""

    def carry(method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Answer:
        request = urllib.request.Request(
            f"{server.rstrip('/')}{path}",
            data=body or None,
            method=method,
            headers={"Content-Type": "application/json", **headers},
        )
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_SECONDS) as response:
                return Answer(response.status, json.load(response))
        except urllib.error.HTTPError as error:
            return Answer(error.code, _content(error.read()))
        except (OSError, ValueError) as error:
            raise RefusedError(f"{server} does not answer: {error}") from error

    return carry


@contextmanager
def unlimited() -> Iterator[None]:
    """Without the limits on requests of one address, and without a line of the log for each, while this
    process asks itself.
    """
    requests = logging.getLogger("crowd.requests")
    level = requests.level
    requests.setLevel(logging.WARNING)
    before = {
        name: getattr(settings, name)
        for name in ("FRONTRUNNER_ENROLMENTS_PER_HOUR", "FRONTRUNNER_READS_PER_MINUTE")
    }
    for name in before:
        setattr(settings, name, 0)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(settings, name, value)
        requests.setLevel(level)


@dataclass(frozen=True)
class _Installed:
    """An installation: the place of its device, its number among that device's, and its newest session's
    release and start.
    """

    device: int
    number: int
    token: str
    release: int
    started_at: datetime


class Crowd:
    """COUNT devices that send to a server by CARRY, allowed to by PERMIT.

    The same SEED on the same front and day sends the same, on another front other sessions of the same
    devices. What is sent as probes depends on what the server asks for, too. Raises RefusedError where the
    server refuses the question for the front.
    """

    def __init__(
        self, carry: Transport, permit: str, count: int, seed: int, today: datetime, application: str
    ) -> None:
        self.carry, self.permit, self.seed = carry, permit, seed
        self.midnight = datetime.combine(today.date(), time.min, UTC)
        self.path = f"{API}/manifest?application={application}"
        self.manifest = _asked(carry("GET", self.path, b"", {}), 200)
        slug = self.manifest["front_version"]
        self.front = configurations_of(_asked(carry("GET", f"{API}/fronts/{slug}", b"", {}), 200))
        self.devices = devices(count, self.front, seed)
        self.installed: dict[tuple[int, int], _Installed] = {}

    def send(self, sessions: int) -> Iterator[Progress]:
        """Enrol and submit every device with SESSIONS sessions, and tell after each device how far it is.
        Raises RefusedError at the first refusal.
        """
        done, runs = 0, 0
        for place, device in enumerate(self.devices):
            random = self._random(place, 1)
            count = min(device.installations, sessions)
            tokens = [_enrolled(self.carry, self.manifest, self.permit) for _ in range(count)]
            for sent in _sessions(device, self.front, self.manifest, sessions, count, self.midnight, random):
                token = tokens[sent.installation]
                runs += _submitted(self.carry, self.manifest, token, device.descriptions[sent.release], sent)
                self.installed[place, sent.installation] = _Installed(
                    place, sent.installation, token, sent.release, sent.started_at
                )
                done += 1
            yield Progress(place + 1, done, runs)

    def send_probes(self, share: float) -> Iterator[Progress]:
        """Let a SHARE (0 to 1) of the installations that sent sessions ask what to measure besides, and send
        it. Tells after each device how far it is. Raises RefusedError at the first refusal.
        """
        done, runs = 0, 0
        for place, device in enumerate(self.devices):
            random = self._random(place, 3)
            for each in (one for one in self.installed.values() if one.device == place):
                if random.random() >= share:
                    continue
                headers = {"Authorization": f"Bearer {each.token}"}
                asked = _asked(self.carry("GET", f"{self.path}&minutes={MINUTES}", b"", headers), 200)
                if not asked["assigned"]:
                    continue
                started_at = each.started_at + PAUSE
                document = session(
                    device, each.number, each.release, self.front, asked, False, started_at, random
                )
                sent = _Sent(each.number, each.release, started_at, document)
                description = device.descriptions[each.release]
                runs += _submitted(self.carry, self.manifest, each.token, description, sent)
                done += 1
            yield Progress(place + 1, done, runs)

    def _random(self, place: int, purpose: int) -> np.random.Generator:
        slug = self.manifest["front_version"].encode()
        return np.random.default_rng((self.seed, place + 1, purpose, *slug))


@dataclass(frozen=True)
class _Sent:
    installation: int
    release: int
    started_at: datetime
    document: dict[str, Any]


def _sessions(
    device: SimulatedDevice,
    front: tuple[Configuration, ...],
    manifest: Mapping[str, Any],
    count: int,
    installations: int,
    midnight: datetime,
    random: np.random.Generator,
) -> Iterator[_Sent]:
    """COUNT sessions of DEVICE over the days before MIDNIGHT, oldest first; its driver is renewed on the
    way.
    """
    whole = random.random() < WHOLE_FRONT
    ages = np.sort(random.uniform(0.0, DAYS, count))[::-1]
    seen: set[int] = set()
    for place, age in enumerate(ages):
        release = place * len(device.descriptions) // count
        every = whole and release not in seen
        seen.add(release)
        installation = place % installations
        started_at = midnight - timedelta(days=float(age))
        document = session(device, installation, release, front, manifest, every, started_at, random)
        yield _Sent(installation, release, started_at, document)


def _enrolled(carry: Transport, manifest: Mapping[str, Any], permit: str) -> str:
    wish = {"app": APP, "simulated": permit, **_versions(manifest)}
    token: str = _asked(carry("POST", f"{API}/enrol", json.dumps(wish).encode(), {}), 201)["token"]
    return token


def _submitted(
    carry: Transport, manifest: Mapping[str, Any], token: str, description: Mapping[str, Any], sent: _Sent
) -> int:
    """How many runs of what was SENT by a device of DESCRIPTION the server took."""
    document = {
        "schema_version": 1,
        **_versions(manifest),
        "device": description,
        "sessions": [sent.document],
    }
    headers = {
        "Authorization": f"Bearer {token}",
        "Idempotency-Key": str(uuid.uuid4()),
        "Content-Encoding": "gzip",
    }
    body = gzip.compress(json.dumps(document).encode(), 1)
    answer = _asked(carry("POST", f"{API}/submissions", body, headers), 202)
    return sum(item["status"] == "accepted" for item in answer["items"])


def _versions(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "app_version": manifest["minimum_app_version"],
        "consent_version": manifest["consent_version"],
    }


def _asked(answer: Answer, status: int) -> Any:
    """The content of ANSWER. Raises RefusedError where its status is another."""
    if answer.status == status:
        return answer.content
    code = answer.content.get("code", answer.status)
    if code == "session_taken":
        raise RefusedError("this crowd is there already: remove it first (--remove), or take another --seed")
    if code == "too_many_requests":
        raise RefusedError(
            f"{answer.content['detail']}; what was sent stays. FRONTRUNNER_ENROLMENTS_PER_HOUR bounds a "
            "crowd that comes from one address: raise it there, or send fewer --devices"
        )
    raise RefusedError(f"{code}: {answer.content.get('detail', 'the server says nothing more')}")


def _content(content: bytes) -> Any:
    try:
        return json.loads(content)
    except ValueError:
        return {}


def _own_host() -> str:
    """A host that this deployment serves."""
    named = [host for host in settings.ALLOWED_HOSTS if host != "*"]
    return named[0].lstrip(".") if named else "localhost"
