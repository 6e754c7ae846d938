"""Sends simulated sessions through the real API, in this process or to another server."""

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

from crowd.results.simulation.devices import Configuration, SimulatedDevice, devices, read_configurations
from crowd.results.simulation.sessions import session

APP = "simulate_crowd"
API = "/api/v1"
DAYS = 90  # over which the sessions are spread
WHOLE_FRONT_SHARE = 0.3  # of the devices measure all configurations, in their first session of each release
PROBE_MINUTES = 2  # for a session of probes
PROBE_PAUSE = timedelta(hours=1)  # before a session of probes
TIMEOUT_SECONDS = 60


class RefusedError(Exception):
    """The server refused a request; the message is its response."""


@dataclass(frozen=True)
class Response:
    """The status and the decoded body of a response."""

    status: int
    content: Any


class Transport(Protocol):
    """Sends a request to the API."""

    def __call__(self, method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Response:
        """The response of the server. Raises RefusedError if it cannot be reached."""


@dataclass(frozen=True)
class Progress:
    """The numbers of devices and sessions sent, and of runs accepted."""

    devices: int
    sessions: int
    runs: int


def in_process() -> Transport:
    """A transport to the application in this process, without a server."""
    application = WSGIHandler()

    def transport(method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Response:
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
        return Response(int(status[0].split()[0]), _parse_json(content))

    return transport


def over_http(server: str) -> Transport:
    """A transport to SERVER, such as https://host."""

    def transport(method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Response:
        request = urllib.request.Request(
            f"{server.rstrip('/')}{path}",
            data=body or None,
            method=method,
            headers={"Content-Type": "application/json", **headers},
        )
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_SECONDS) as response:
                return Response(response.status, json.load(response))
        except urllib.error.HTTPError as error:
            return Response(error.code, _parse_json(error.read()))
        except (OSError, ValueError) as error:
            raise RefusedError(f"{server} cannot be reached: {error}") from error

    return transport


@contextmanager
def without_limits() -> Iterator[None]:
    """Disables rate limits of an address, and log lines of requests, while this process is its own client."""
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
        self, transport: Transport, permit: str, count: int, seed: int, today: datetime, application: str
    ) -> None:
        self.transport, self.permit, self.seed = transport, permit, seed
        self.midnight = datetime.combine(today.date(), time.min, UTC)
        self.path = f"{API}/manifest?application={application}"
        self.manifest = _checked_content(transport("GET", self.path, b"", {}), 200)
        slug = self.manifest["front_version"]
        front = _checked_content(transport("GET", f"{API}/fronts/{slug}", b"", {}), 200)
        self.front = read_configurations(front)
        self.devices = devices(count, self.front, seed)
        self.installed: dict[tuple[int, int], _Installed] = {}

    def send(self, sessions: int) -> Iterator[Progress]:
        """Enrol all devices and submit SESSIONS sessions of each. Yields the progress after each device.

        Raises RefusedError at the first refusal.
        """
        done, runs = 0, 0
        for place, device in enumerate(self.devices):
            random = self._random(place, 1)
            count = min(device.installations, sessions)
            tokens = [_enrol(self.transport, self.manifest, self.permit) for _ in range(count)]
            for sent in _random_sessions(
                device, self.front, self.manifest, sessions, count, self.midnight, random
            ):
                token = tokens[sent.installation]
                runs += _submit(self.transport, self.manifest, token, device.descriptions[sent.release], sent)
                self.installed[place, sent.installation] = _Installed(
                    place, sent.installation, token, sent.release, sent.started_at
                )
                done += 1
            yield Progress(place + 1, done, runs)

    def send_probes(self, share: float) -> Iterator[Progress]:
        """Let a SHARE (0 to 1) of the installations request probes and submit them.

        Yields the progress after each device. Raises RefusedError at the first refusal.
        """
        done, runs = 0, 0
        for place, device in enumerate(self.devices):
            random = self._random(place, 3)
            for each in (one for one in self.installed.values() if one.device == place):
                if random.random() >= share:
                    continue
                headers = {"Authorization": f"Bearer {each.token}"}
                asked = _checked_content(
                    self.transport("GET", f"{self.path}&minutes={PROBE_MINUTES}", b"", headers), 200
                )
                if not asked["assigned"]:
                    continue
                started_at = each.started_at + PROBE_PAUSE
                document = session(
                    device, each.number, each.release, self.front, asked, False, started_at, random
                )
                sent = _Sent(each.number, each.release, started_at, document)
                description = device.descriptions[each.release]
                runs += _submit(self.transport, self.manifest, each.token, description, sent)
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


def _random_sessions(
    device: SimulatedDevice,
    front: tuple[Configuration, ...],
    manifest: Mapping[str, Any],
    count: int,
    installations: int,
    midnight: datetime,
    random: np.random.Generator,
) -> Iterator[_Sent]:
    """COUNT sessions of DEVICE over the days before MIDNIGHT, oldest first, with ever newer drivers."""
    whole = random.random() < WHOLE_FRONT_SHARE
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


def _enrol(transport: Transport, manifest: Mapping[str, Any], permit: str) -> str:
    enrolment = {"app": APP, "simulated": permit, **_versions(manifest)}
    body = json.dumps(enrolment).encode()
    token: str = _checked_content(transport("POST", f"{API}/enrol", body, {}), 201)["token"]
    return token


def _submit(
    transport: Transport, manifest: Mapping[str, Any], token: str, description: Mapping[str, Any], sent: _Sent
) -> int:
    """Submit SENT, of a device with DESCRIPTION. Returns how many runs the server accepted."""
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
    response = _checked_content(transport("POST", f"{API}/submissions", body, headers), 202)
    return sum(item["status"] == "accepted" for item in response["items"])


def _versions(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "app_version": manifest["minimum_app_version"],
        "consent_version": manifest["consent_version"],
    }


def _checked_content(response: Response, status: int) -> Any:
    """The content of RESPONSE. Raises RefusedError if its status is not STATUS."""
    if response.status == status:
        return response.content
    code = response.content.get("code", response.status)
    if code == "session_taken":
        raise RefusedError("this crowd exists already: remove it first (--remove), or give another --seed")
    if code == "too_many_requests":
        raise RefusedError(
            f"{response.content['detail']}; sessions sent so far stay. FRONTRUNNER_ENROLMENTS_PER_HOUR "
            "limits the devices from one address: raise it on the server, or give fewer --devices"
        )
    raise RefusedError(f"{code}: {response.content.get('detail', 'no details')}")


def _parse_json(content: bytes) -> Any:
    try:
        return json.loads(content)
    except ValueError:
        return {}


def _own_host() -> str:
    """A host name that this deployment serves."""
    named = [host for host in settings.ALLOWED_HOSTS if host != "*"]
    return named[0].lstrip(".") if named else "localhost"
