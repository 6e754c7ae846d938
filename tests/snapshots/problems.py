"""A request for each code of a problem that a single request can bring about."""

from collections.abc import Iterator
from functools import partial
from typing import Any

from django.db.models import Model
from django.utils import timezone

from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.fronts.models import IntakePolicy
from crowd.results.models import Export
from tests.builders.documents import FRAMES, device_document, session_document, submission_document
from tests.snapshots.database import COMPUTER, Site
from tests.snapshots.questions import Question, bearer, call, enrolment, lease, leased, result

# What no request of a test client brings about, and why.
NOT_ASKED = {
    "body_incomplete": "the connection ends",
    "body_too_slow": "a slow connection",
    "busy": "many requests at once",
    "demo_server": "a demo is a server of its own",
    "server_busy": "many large bodies at once",
    "database_unavailable": "the database fails",
    "files_unavailable": "a bucket fails",
    "internal_error": "the server fails",
    "server_not_prepared": "its tables or static files are missing",
    "inflated_too_large": "its text counts bytes, which differ between versions of zlib",
    "forbidden": "only pages of administrators refuse so",
    "front_outdated": "the program changes",
}


def problems(site: Site) -> Iterator[Question]:
    """Requests that are refused."""
    yield from _requests()
    yield from _access(site)
    yield from _submissions(site)
    yield from _runs(site)
    yield from _reading()
    yield from _leases(site)


def _problem(path: str, **changes: Any) -> Question:
    return call("problems", path, **changes)


def _enrol(body: Any, **changes: Any) -> Question:
    return _problem("enrol", method="POST", body=body, **changes)


def _requests() -> Iterator[Question]:
    yield _problem("fronts", headers={"Host": "elsewhere.example"})
    yield _problem("nothing")
    yield _problem("fronts", method="DELETE")
    for path in (
        *("fronts?limit=0", "devices?cursor=nonsense", "speedups?colour=red", "speedups?since=yesterday"),
        *("compare?devices=a", "fronts?cursor=%00"),
    ):
        yield _problem(path)
    yield _enrol(b" " * ((1 << 19) + 1))
    for body, header in (
        (b"not gzip", {"Content-Encoding": "gzip"}),
        (b"{}", {"Content-Encoding": "br"}),
        (b"{}", {"Transfer-Encoding": "chunked"}),
        (b"a=b", {"Content-Type": "application/x-www-form-urlencoded"}),
    ):
        yield _enrol(body, headers=header)
    for body in (b"{", b'{"app": NaN}', enrolment(app=3), enrolment(app="a" * 70_000)):
        yield _enrol(body)
    yield _enrol(b"[" + b"0," * 160_001 + b"0]")


def _access(site: Site) -> Iterator[Question]:
    token = bearer(site.participants["rare"].token)
    yield _enrol(enrolment(app_version="0.0.1"))
    yield _enrol(enrolment(consent_version=1))
    yield _problem("me")
    yield _problem("me", headers=bearer("unknown"))
    yield _problem("fronts", before=(call("", "fronts"),), settings={"FRONTRUNNER_READS_PER_MINUTE": 1})
    keyed = token | {"Idempotency-Key": "k"}
    close_intake = partial(IntakePolicy.objects.create, accepting=False)
    for changes in ({"before": (close_intake,)}, {"settings": {"FRONTRUNNER_BYTES_PER_DAY": 1}}):
        yield _problem("submissions", method="POST", body=submission_document(), headers=keyed, **changes)


def _submissions(site: Site) -> Iterator[Question]:
    token = bearer(site.participants["confirmed 0"].token)
    keyed = token | {"Idempotency-Key": "k"}

    def sent(body: Any, headers: dict[str, str] = keyed, **changes: Any) -> Question:
        return _problem("submissions", method="POST", body=body, headers=headers, **changes)

    deep: Any = "bottom"
    for _ in range(9):
        deep = [deep]
    yield sent(submission_document(), token)
    yield sent(submission_document(), before=(sent(submission_document(session_document(best_us=9_000))),))
    for device in (COMPUTER, device_document(deep=deep), device_document(text="a" * 17_000)):
        yield sent(submission_document(device=device))
    for member in ({"deep": deep}, {"text": "a" * 5_000}, {"email": "a"}):
        yield sent(submission_document(**member))
    yield sent(submission_document(session_document(runs=[])))
    yield sent(submission_document(schema_version=2))


def _runs(site: Site) -> Iterator[Question]:
    """Two checks: of runs that are refused each for a reason of its own, and of one that is refused alone."""
    headers = bearer(site.participants["confirmed 0"].token)
    stored = site.sessions["confirmed 0"]
    wrong: tuple[dict[str, Any], ...] = (
        {"configuration": "unheard-of"},
        {"frame_us": [1]},
        {"frame_us": [-1] * FRAMES},
        {"frame_us": [0] * FRAMES, "stages_us": None},
        {"frame_us": [70_000_000] * FRAMES},
        {"ate_max": -1.0},
        {"deviation": None},
        {"repeat": 9},
        {"stages_us": {f"stage_{number}": [1] * FRAMES for number in range(17)}},
        {"tracked": FRAMES + 1},
    )
    first = session_document()["runs"][0]
    each = [session_document(runs=[first | changes]) for changes in wrong]
    of_sessions: tuple[dict[str, Any], ...] = (
        {"empty_frame_us": None},
        {"stage_clock": None},
        {"stage_clock": "none"},
        {"backend": "wasm"},
        {"threads": 2},
        {"front_version": "kfusion-unknown"},
        {"protocol_version": 1},
        {"samples": [{"t": 0.1}] * 9},
        {"id": site.sessions["rare"]["id"]},
        {"id": stored["id"], "runs": [first]},
        {"runs": [first | {"ate_max": 0.0482, "deviation": 0.0}]},
        {"runs": [first | {"ate_mean": 0.0125}]},
        {"runs": [first | {"cpu_us": 10**12}]},
    )
    each += [session_document(runs=[first]) | changes for changes in of_sessions]
    for place, session in enumerate(each):
        session["runs"] = [run | {"id": f"00000000-0000-4000-8000-{place:012}"} for run in session["runs"]]
    body = submission_document(*each, device=device_document(cpu_count="8"))
    yield _problem("submissions:validate", method="POST", body=body, headers=headers)
    yield _problem("submissions:validate", method="POST", body=submission_document(each[0]), headers=headers)


def _reading() -> Iterator[Question]:
    yield _problem("manifest?application=elasticfusion")
    yield _problem("devices/no-such-device")
    yield Question("problems", "/data/1999-01-01/runs.parquet")
    remove = partial(_update, Export, removed_at=timezone.now())
    yield Question("problems", "/data/2026-11-22/runs.parquet", before=(remove,))
    yield Question("problems", "/data/latest/runs.parquet", before=(Export.objects.all().delete,))


def _leases(site: Site) -> Iterator[Question]:
    yield lease(site, "problems", device="bench")
    yield lease(site, "problems", lease_version=1)
    for change in (
        partial(_update, ReferenceDevice, set_aside="its answers contradict"),
        partial(_update, Exploration, sequence="lost"),
    ):
        yield lease(site, "problems", before=(change,))
    yield leased(site, "heartbeat", file="problems", before=())
    failed = {"status": "failed", "error": "out of memory"}
    done = leased(site, "result", result(site))
    yield leased(site, "result", failed, "problems", before=(lease(site), done))


def _update(model: type[Model], **columns: Any) -> None:
    """Change all rows of `model`."""
    model._default_manager.update(**columns)
