"""What is asked of the filled server: every call of the API, and every table and file that programs read."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from django.urls import reverse

from crowd.dashboard.urls import urlpatterns as pages
from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceModel
from crowd.explorations.models import Evaluation
from crowd.results.opendata.tables import TABLES
from tests.builders.documents import session_document, submission_document
from tests.builders.explorations import measurement
from tests.builders.participant import API
from tests.snapshots.database import Site

DRAWN = re.compile(r"\.(json|csv)$")


@dataclass(frozen=True)
class Question:
    """A request; its answer belongs to the snapshot `file`. `body`: bytes, or what becomes JSON.

    `before`: requests that are sent first, and changes of the database; `settings`: the server's meanwhile.
    """

    file: str
    path: str
    method: str = "GET"
    body: Any = None
    headers: dict[str, str] = field(default_factory=dict)
    before: tuple["Question | Callable[[], Any]", ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.method} {self.path}"


def questions(site: Site) -> Iterator[Question]:
    """All of them. Each is asked of the database as it was filled: no answer depends on another."""
    yield from _reading(site)
    yield from _own(site)
    yield from _sending(site)
    yield from _leases(site)
    yield from _tables(site)
    yield from _files()


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def call(file: str, path: str, **changes: Any) -> Question:
    return Question(file, f"{API}/{path}", **changes)


def reading(path: str, **changes: Any) -> Question:
    """A call whose answer belongs to the file of its first word: `devices`, or `device` for one of them."""
    word, one = re.match(r"(\w+)(/?)", path).groups()  # type: ignore[union-attr]
    return call(word.removesuffix("s") if one else word, path, **changes)


def _reading(site: Site) -> Iterator[Question]:
    """Calls without a token."""
    masked = public_device(DeviceModel.objects.get(slug="huawei-p30")).slug
    uuids = {name: session["id"] for name, session in site.sessions.items()}
    for path in (
        *("speedups?", "speedups?configuration=all&suspect=0", "speedups?simulated=1&limit=2"),
        *("speedups?front=kfusion-early", "speedups?os=Linux&backend=opencl&min_sessions=1&since=2026-11-01"),
        *("devices?", "devices?simulated=1&limit=2", "devices/google-pixel-8", f"devices/{masked}"),
        f"compare?devices=google-pixel-8,{masked}",
        *("sessions?", "sessions?valid=0", "sessions?confirmed=1&limit=1", "sessions?simulated=1&limit=1"),
        *(f"sessions/{uuids[name]}" for name in ("modern", "browser 0", "failed", "pending")),
        *("runs?limit=3", "runs?valid=0", f"runs?session={uuids['contended']}"),
        *("exports?limit=1", "manifest", "fronts", "fronts?limit=1", "fronts/kfusion-test"),
        *("recommendation?", "recommendation?model=google-pixel-8", "recommendation?gpu=Adreno"),
        "recommendation?model=huawei&max_ate=0.02&max_ms=40",
        *("models?maker=Google&search=pixel+8", "explorations", f"explorations/{site.finished}?limit=4"),
        *(f"explorations/{site.running}?limit=2", "openapi.json"),
    ):
        yield reading(path)
    yield Question("ready", "/readyz")


def _own(site: Site) -> Iterator[Question]:
    """Calls with the token of an installation."""
    token = bearer(site.participants["rare"].token)
    run = site.sessions["rare"]["runs"][0]["id"]
    yield call("own", "me", headers=token)
    yield call("own", "me", method="PATCH", body={"show_model": True}, headers=token)
    yield call("own_data", "me/data", headers=token)
    yield call("token", "me/token", method="POST", headers=token)
    yield call("erase", f"me/runs/{run}", method="DELETE", headers=token)
    yield call("erase", "me", method="DELETE", headers=token)
    pending = bearer(site.participants["pending"].token)
    yield reading(f"submissions/{site.submission}", headers=pending)
    confirmed = bearer(site.participants["confirmed 0"].token)
    for path in ("manifest?minutes=9", "recommendation"):
        yield reading(path, headers=confirmed)


def _sending(site: Site) -> Iterator[Question]:
    """Calls of a client that has something to say."""
    token = bearer(site.participants["confirmed 0"].token)
    good, mixed = session_document(), session_document()
    mixed["runs"][1]["configuration"] = "unheard-of"
    mixed["runs"].append(site.sessions["confirmed 0"]["runs"][0])
    keyed = token | {"Idempotency-Key": "snapshot"}
    body = submission_document(good, mixed)
    sent = call("submit", "submissions", method="POST", body=body, headers=keyed)
    yield call("enrol", "enrol", method="POST", body=enrolment())
    yield sent
    yield call("submit", "submissions", method="POST", body=body, headers=keyed, before=(sent,))
    yield call("validate", "submissions:validate", method="POST", body=body, headers=token)
    attempt = {"step": "failed", "reason": "does_not_fit", "gpu_vendor": "arm", "browser": "Chrome"}
    yield call("attempt", "attempts", method="POST", body=attempt)


def enrolment(**changes: Any) -> dict[str, Any]:
    """The body of an enrolment."""
    return {"app": "client_kit", "app_version": "0.1.0", "consent_version": 2} | changes


def _leases(site: Site) -> Iterator[Question]:
    """Calls of a machine that measures for a reference device."""
    yield lease(site)
    yield leased(site, "heartbeat")
    for body in (result(site), {"status": "failed", "error": "out of memory"}, {"status": "returned"}):
        yield leased(site, "result", body)


def leased(site: Site, what: str, body: Any = None, file: str = "lease", **changes: Any) -> Question:
    """`what` a machine sends of the next evaluation once it has it."""
    path = f"leases/{next_evaluation(site).pk}-1/{what}"
    sent = {"method": "POST", "body": body, "headers": bearer(site.board), "before": (lease(site),)}
    return call(file, path, **(sent | changes))


def next_evaluation(site: Site) -> Evaluation:
    """The evaluation that the board gets next."""
    return Evaluation.objects.filter(exploration=site.running, state=Evaluation.State.PENDING)[0]


def result(site: Site) -> dict[str, Any]:
    """The result of the next evaluation."""
    waiting = next_evaluation(site)
    measured = measurement(waiting.configuration)
    return {
        "status": "done",
        "objectives": measured.objectives,
        "stages": measured.stages,
        "device": measured.device,
        "parts": [
            {"sequence": name, "lost": 0, "objectives": measured.objectives} for name in ("tiny", "desk")
        ],
        "software": "client_kit 0.1.0",
        "configuration": waiting.configuration,
    }


def lease(site: Site, file: str = "lease", before: tuple[Any, ...] = (), **members: Any) -> Question:
    """The request for the next evaluation, with `members` changed."""
    body = {"device": "board", "worker": "board 7", "lease_version": 2} | members
    return call(file, "leases", method="POST", body=body, headers=bearer(site.board), before=before)


def _tables(site: Site) -> Iterator[Question]:
    """Tables of the dashboard and figures, as CSV and JSON; evaluations of a search."""
    # By the first word of a page's name.
    arguments: dict[str, dict[str, Any]] = {
        "device": {"slug": "google-pixel-8"},
        "groups": {"by": "vendor"},
        "front": {"slug": "kfusion-test"},
        "exploration": {"key": site.finished, "objective": "runtime"},
        "evaluations": {"key": site.finished},
        "session": {"uuid": site.sessions["modern"]["id"]},
        "run": {"uuid": site.sessions["modern"]["runs"][1]["id"]},
    }
    queries = {"compare": "?devices=google-pixel-8,samsung-sm-s918b", "front": "?against=kfusion-early"}
    for page in pages:
        if DRAWN.search(str(page.pattern)):
            word = page.name.partition("-")[0]
            needed = {name: arguments[word][name] for name in page.pattern.converters}
            address = reverse(f"dashboard:{page.name}", kwargs=needed) + queries.get(word, "")
            name, _, kind = page.name.rpartition("-")
            yield Question(f"figures/{name}" if kind == "figure" else f"tables/{name}", address)


def _files() -> Iterator[Question]:
    """Files of the open data. The older export held what was erased since."""
    for name in ("datapackage.json", "LICENCE.txt"):
        yield Question("data/description", f"/data/latest/{name}")
    for table in TABLES:
        for kind in ("parquet", "csv.gz"):
            yield Question(f"data/{table.name}", f"/data/latest/{table.name}.{kind}")
    yield Question("data/tombstones", "/data/2026-11-21/tombstones.csv.gz")
