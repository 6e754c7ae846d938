"""An honest crowd behind a proxy, and one attacker with one address who sends what it likes."""

import gzip
import http.client
import itertools
import json
import random
import sqlite3
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slam.system import STAGES
from tests.builders.documents import (
    DEFAULT_SECONDS,
    front_document,
    predict,
    run_document,
    session_document,
    submission_document,
    write_pack,
)
from tests.services.serving import Services, Serving, commands

FRONT = "kfusion-crowd"
DEFAULT_US, SPEEDUP, NOISE = 24_000, 2.0, 0.03
# What a session may differ from others of its device without being an outlier: 1.61 times.
PLAUSIBLE = 1.59
# What the front's prediction allows a new model: 4 times.
INVENTED = 3.8
# Part of each text that the attacker sends; letters alone, so that no rule for names takes it apart.
WORD = "Mallory"
ENROLMENT = {"app": "test", "app_version": "0.1.0", "consent_version": 2}
ATTACKER, READER = "203.0.113.66", "198.51.100.7"
Document = dict[str, Any]


@dataclass(frozen=True)
class Chip:
    """What a device with this chip says of it."""

    opencl_platform: str
    opencl_device: str
    opencl_driver: str
    soc_manufacturer: str | None = None
    soc_model: str | None = None
    cpu: str | None = None


MODELS: tuple[tuple[str, str, str, Chip], ...] = (
    ("Android", "Google", "Pixel 8",
     Chip("ARM Platform", "Mali-G715", "3.0 v1.r44p1", "Google", "Tensor G3")),
    ("Android", "samsung", "SM-S911B", Chip("QUALCOMM Snapdragon(TM)", "QUALCOMM Adreno(TM) 740",
     "OpenCL 3.0 QUALCOMM build: commit #2 Compiler E031.41.03.36", "QTI", "SM8550")),
    ("Android", "Xiaomi", "MI 9", Chip("QUALCOMM Snapdragon(TM)", "QUALCOMM Adreno(TM) 640",
     "OpenCL 2.0 QUALCOMM build: commit #1 Compiler E031.37.12.07", "QTI", "SM8150")),
    ("Linux", "Dell Inc.", "XPS 15 9520", Chip("NVIDIA CUDA", "NVIDIA GeForce RTX 3060", "560.94",
     cpu="12th Gen Intel(R) Core(TM) i7-12700H")),
    ("Windows 11", "LENOVO", "20W0CTO1WW", Chip("Intel(R) OpenCL Graphics", "Intel(R) Iris(R) Xe Graphics",
     "31.0.101.5186", cpu="11th Gen Intel(R) Core(TM) i5-1135G7")),
    ("Linux", "HP", "Z2 G9 Tower Workstation", Chip("Portable Computing Language",
     "cpu-skylake-Intel(R) Core(TM) i9-9900K CPU @ 3.60GHz", "5.0",
     cpu="Intel(R) Core(TM) i9-9900K CPU @ 3.60GHz")),
)  # fmt: skip


def publish_front(var: Path, services: Services) -> None:
    """Publish FRONT, of two pairs a session, on the data folder `var`."""
    document = front_document(write_pack(var / "sequences"), FRONT.removeprefix("kfusion-"))
    _, best, _ = document["configurations"]
    predict(best, runtime=DEFAULT_SECONDS / SPEEDUP)
    path = var / "front.json"
    path.write_text(json.dumps(document))
    commands(var, "migrate", f"front publish {path} --yes", **services)


def device(system: str, maker: str, model: str, chip: Chip, **changes: Any) -> Document:
    """The description of such a device."""
    return {"os": system, "os_version": "16", "manufacturer": maker, "model": model} | vars(chip) | changes


def session(speedup: float, chance: random.Random, **changes: Any) -> Document:
    """Default, best, best, default with `speedup` and a few per cent of noise; no other has the same
    times."""
    runs = []
    for order, (name, repeat) in enumerate([("default", 0), ("best", 0), ("best", 1), ("default", 1)]):
        level = DEFAULT_US / (speedup if name == "best" else 1) * chance.gauss(1, 0.01)
        times = [max(round(level * chance.gauss(1, NOISE)), 1) for _ in range(100)]
        runs.append(run_document(name, repeat, order, 1, frame_us=times, stages_us=None, tracked=None))
    return session_document(FRONT, runs=runs) | changes


def submission(described: Document, *sessions: Document, **changes: Any) -> Document:
    """One request of such a device."""
    return submission_document(*sessions, device=described, **changes)


@dataclass
class Caller:
    """Someone at `address`, as the proxy in front of the server reports it."""

    server: Serving
    address: str
    statuses: list[int] = field(default_factory=list)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, bytes]:
        """Status and content of one request. A document is sent as JSON, bytes as they are, both packed."""
        content = body if isinstance(body, bytes | None) else json.dumps(body).encode()
        more = {"X-Forwarded-For": self.address, "Content-Type": "application/json"} | headers
        if content is not None:
            content, more = gzip.compress(content, 1), more | {"Content-Encoding": "gzip"}
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=60)
        try:
            connection.request(method, path, content, more)
            answer = connection.getresponse()
            self.statuses.append(answer.status)
            return answer.status, answer.read()
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        """The JSON at `path`."""
        status, content = self.ask("GET", path)
        assert status == 200, (path, content)
        return json.loads(content)

    def enrol(self, app: str = "test") -> "Installation | None":
        """A new installation; None where there were too many from this address."""
        status, content = self.ask("POST", "/api/v1/enrol", ENROLMENT | {"app": app})
        if status == 429:
            return None
        assert status == 201, content
        answer = json.loads(content)
        return Installation(self, answer["token"], answer["installation_id"])


@dataclass(frozen=True)
class Installation:
    """An enrolled caller."""

    caller: Caller
    token: str
    id: str

    def send(self, body: Any, key: str = "") -> int:
        """The status that a submission of `body` is answered with."""
        return self.caller.ask(
            "POST",
            "/api/v1/submissions",
            body,
            **{"Authorization": f"Bearer {self.token}", "Idempotency-Key": key or str(uuid.uuid4())},
        )[0]


@dataclass(frozen=True)
class Board:
    """A machine that measures with the `token` of a reference device."""

    caller: Caller
    token: str

    def take(self) -> Document:
        """The next lease."""
        status, content = self._post("", {"lease_version": 2})
        assert status == 201, content
        return dict(json.loads(content))

    def result(self, lease: Document, software: str = "client_kit 0.1.0", **changes: float) -> Document:
        """An honest result of `lease`, with `changes` of its objectives."""
        objectives = {"runtime": 0.1, "ate_max": 0.01, "ate_mean": 0.005} | changes
        stages = dict.fromkeys(STAGES, objectives["runtime"] / 5)
        parts = [
            {"sequence": each["name"], "lost": 0, "objectives": objectives} for each in lease["sequences"]
        ]
        result = {"status": "done", "software": software, "objectives": objectives, "stages": stages}
        return result | {"parts": parts}

    def send(self, lease: Document, result: Document) -> int:
        """The status that `result` is answered with."""
        return self._post(f"/{lease['id']}/result", result)[0]

    def _post(self, path: str, document: Document) -> tuple[int, bytes]:
        return self.caller.ask(
            "POST", f"/api/v1/leases{path}", document, Authorization=f"Bearer {self.token}"
        )


def honest_crowd(server: Serving) -> None:
    """Three installations of each of MODELS, each enrolled from a network of its own."""
    chance = random.Random(2)
    for number, model in enumerate(MODELS):
        for network in range(3):
            caller = Caller(server, f"10.{number}.{network}.1")
            member = caller.enrol()
            assert member is not None
            measured = session(SPEEDUP * chance.gauss(1, 0.03), chance)
            assert member.send(submission(device(*model), measured)) == 202


def invented_crowd(server: Serving, models: int, networks: int) -> None:
    """So many invented `models`, each measured in all of the same `networks`, as fast as is plausible."""
    chance = random.Random(4)
    for network in range(networks):
        caller = Caller(server, f"172.{16 + network}.0.1")
        for number in range(models):
            member = caller.enrol()
            assert member is not None
            system, maker, _, chip = MODELS[number % len(MODELS)]
            described = device(system, maker, f"{WORD} {number}", chip)
            assert member.send(submission(described, session(SPEEDUP * INVENTED, chance))) == 202


class Attacker:
    """One address, as many installations as that may have, and every trick that we know of."""

    def __init__(self, server: Serving) -> None:
        self.caller = Caller(server, ATTACKER)
        self.chance = random.Random(3)
        self.members: list[Installation] = []
        self.taken = 0  # submissions that were accepted
        self.worded: list[Document] = []  # sessions with own words

    def attack(self) -> None:
        """Everything, until each request is refused because there were too many."""
        self._enrol()
        fresh = iter(self.members)
        self._ride_on_chips(fresh)
        self._measure_existing_models(fresh)
        self._exaggerate(fresh)
        self._fail(fresh)
        self._use_own_words(fresh)
        self._toggle(next(fresh))
        self._replay(next(fresh))
        self._send_what_cannot_be_read(next(fresh))
        self._fill_the_database(fresh)
        self._use_up_what_is_left()

    def refused_everywhere(self) -> bool:
        """Whether no installation may send anything more, and no other one may be enrolled."""
        body = submission(device(*MODELS[0]), session(SPEEDUP, self.chance))
        return self.caller.enrol() is None and {member.send(body) for member in self.members} == {429}

    def _enrol(self) -> None:
        while (member := self.caller.enrol(f"{WORD}.app")) is not None:
            self.members.append(member)

    def _send(self, member: Installation, described: Document, *sessions: Document, **more: Any) -> int:
        status = member.send(submission(described, *sessions, **more))
        self.taken += status == 202
        return status

    def _ride_on_chips(self, fresh: Iterator[Installation]) -> None:
        """Invented models with the chips of honest ones, as fast as these allow."""
        for number in range(2):
            for system, maker, _, chip in MODELS:
                described = device(system, maker, f"{WORD} {number}", chip)
                self._send(next(fresh), described, session(SPEEDUP * PLAUSIBLE, self.chance), show_model=True)

    def _measure_existing_models(self, fresh: Iterator[Installation]) -> None:
        """The models that are there: with their own chip, and with all other chips of the crowd."""
        for model in MODELS:
            member = next(fresh)
            for *_, chip in MODELS:
                opencl = {name: text for name, text in vars(chip).items() if name.startswith("opencl")}
                sessions = [session(SPEEDUP * PLAUSIBLE, self.chance) for _ in range(2)]
                self._send(member, device(*model) | opencl, *sessions)
            # In the other direction, fewer times.
            self._send(next(fresh), device(*model), session(SPEEDUP / PLAUSIBLE, self.chance))

    def _exaggerate(self, fresh: Iterator[Installation]) -> None:
        """Absurd speedups in both directions, of existing and of invented models, with every backend."""
        slow, fast = 60_000_000, 60
        for (system, maker, model, chip), backend in zip(
            itertools.cycle(MODELS),
            ["opencl", "webgpu", "wasm", "vulkan", "metal", "cuda", "cpu"],
            strict=False,
        ):
            threads = 1 if backend == "wasm" else None
            for default_us, best_us in ((slow, fast), (fast, slow), (4_200_000_000, fast)):
                for name in (model, f"{WORD}{backend}"):
                    extreme = session_document(FRONT, default_us, best_us, backend=backend, threads=threads)
                    self._send(next(fresh), device(system, maker, name, chip), extreme)

    def _fail(self, fresh: Iterator[Installation]) -> None:
        """Failures and lost cameras, on models that are there and on invented ones."""
        for system, maker, model, chip in MODELS:
            for name in (model, f"{WORD} fails"):
                failing = [self._failing() for _ in range(6)]
                self._send(next(fresh), device(system, maker, name, chip), *failing)

    def _failing(self) -> Document:
        made = session(SPEEDUP, self.chance)
        for run in made["runs"]:
            if run["configuration"] == "best":
                run["ate_max"] = 1.0
        made["runs"][1] |= {"status": "failed", "failure": WORD}
        return made

    def _use_own_words(self, fresh: Iterator[Installation]) -> None:
        """The attacker's text wherever a text is taken."""
        script = f"<script>{WORD}</script>"
        chip = MODELS[0][3]
        for name in (*vars(chip), "os", "os_version", "manufacturer", "model", "board", "board_platform",
                     "brand", "device", "product", "egl", "anything"):  # fmt: skip
            described = device(*MODELS[0]) | {name: f"=1+1 {WORD} {name} 999 {script}"}
            self._send(next(fresh), described, self._worded(script), show_model=True, note=f"{WORD} note")
        for described in (
            {"os": WORD, "model": WORD, "manufacturer": WORD, "cpu": WORD},
            device("Linux", WORD, f"{WORD}-{WORD}", chip),
            device("Android", "Google", f"Pixel {WORD}", chip),
        ):
            self._send(next(fresh), described, self._worded(WORD), show_model=True)

    def _worded(self, text: str) -> Document:
        """A session with `text` in everything that it says besides numbers."""
        made = session(SPEEDUP, self.chance, extra={"note": text}, note=text)
        made |= {"started_at": "0001-01-01T00:00:00Z"}
        made["samples"] = [
            {"t": 0.0, "note": text, "temperature_c": 1e308, "cpu_mhz": -1e308, "battery": 1e308}
        ]
        made["runs"][3] |= {"ate_mean": 5e-324, "ate_rmse": 5e-324, "order": 32_767, "tracked": 100}
        first, second, *_ = made["runs"]
        first |= {"status": "failed", "failure": f"{text}: out of memory", "note": text}
        second |= {"stages_us": {WORD.lower(): second["frame_us"]}}
        self.worded.append(made)
        return made

    def _toggle(self, member: Installation) -> None:
        """The model named and not named, with each submission."""
        for number in range(12):
            self._send(member, device(*MODELS[1]), session(SPEEDUP, self.chance), show_model=bool(number % 2))

    def _replay(self, member: Installation) -> None:
        """The same again: under its key, under another, with other ids, and dated over twenty years."""
        body = submission(device(*MODELS[2]), session(SPEEDUP * PLAUSIBLE, self.chance))
        for key in ("once", "once", "twice"):
            self.taken += member.send(body, key) == 202
        for year in range(2006, 2026):
            again = session(SPEEDUP * PLAUSIBLE, self.chance, started_at=f"{year}-07-01T12:00:00Z")
            self._send(member, device(*MODELS[2]), again)

    def _send_what_cannot_be_read(self, member: Installation) -> None:
        """Nested and long bodies, and invalid numbers and types."""
        nested = b'{"a":' * 15_000 + b"1" + b"}" * 15_000
        good = submission(device(*MODELS[0]), session(SPEEDUP, self.chance))
        for body in (
            b"[" * 95_000,
            json.dumps(good | {"extra": "here"}).encode().replace(b'"here"', nested),
            json.dumps(good | {"extra": WORD * 100_000}).encode(),
            json.dumps(good | {"device": {str(number): WORD for number in range(20_000)}}).encode(),
            json.dumps(submission(device(*MODELS[0]), *self._stormy(50))).encode(),
            json.dumps(good | {"sessions": [session(2.0, self.chance, backend=WORD)]}).encode(),
            json.dumps(good | {"app_version": WORD}).encode(),
        ):
            assert member.send(body) in {400, 413, 422}

    def _stormy(self, sessions: int) -> list[Document]:
        """`sessions` with 5,000 samples each, one a second, as long as that is possible."""
        samples = [{"t": second} for second in range(5_000)]
        made = []
        for _ in range(sessions):
            one = session(SPEEDUP, self.chance, samples=samples)
            for run in one["runs"]:
                run["frame_us"] = [500_000 if run["configuration"] == "best" else 1_000_000] * 100
            made.append(one)
        return made

    def _fill_the_database(self, fresh: Iterator[Installation]) -> None:
        """The largest sessions that are taken, until the address may store nothing more."""
        members = list(fresh)
        for member in members[:4]:
            assert self._send(member, device(*MODELS[3]), *self._stormy(8)) == 202
        for member in itertools.cycle(members):
            if self._send(member, device(*MODELS[3]), *self._heavy()) == 429:
                return

    def _heavy(self) -> list[Document]:
        """About as many runs as a submission holds, with as much beside them as is kept."""
        made = [session_document(FRONT, note=WORD[0] * 16_000) for _ in range(12)]
        for run in (run for one in made for run in one["runs"]):
            run |= {"frame_us": [], "stages_us": None, "tracked": None, "status": "failed"}
            run |= {"failure": WORD, "note": WORD[0] * 4_000}
        return made

    def _use_up_what_is_left(self) -> None:
        """Garbage of the largest size, until no installation may send anything more."""
        for member in self.members:
            while member.send(b"," * (1 << 20)) != 429:
                pass


def database_bytes(var: Path) -> int:
    """The size of the database in `var` with its log, after a checkpoint."""
    path = var / "frontrunner.sqlite3"
    connection = sqlite3.connect(path, timeout=30)
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    connection.close()
    return sum(file.stat().st_size for file in (path, path.with_name(f"{path.name}-wal")) if file.exists())


def words_in(texts: dict[str, str], words: Sequence[str] = (WORD,)) -> list[str]:
    """Where one of `words` stands in `texts`, whatever the case."""
    return [
        f"{address}: ...{text[max(at - 80, 0) : at + 80]}..."
        for address, text in texts.items()
        for word in words
        if (at := text.casefold().find(word.casefold())) >= 0
    ]
