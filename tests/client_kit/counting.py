"""A server that keeps the interface's promises in memory: every run counts once, whatever is repeated."""

import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.scripted import Reply, Request, problem

CHUNKS = (b"header", b"frames")  # the sequence of an ordinary manifest of tests.builders.manifests


class Counting:
    """Answers as the interface says, from a manifest and the folder of its sequence's chunks."""

    def __init__(self, manifest: dict[str, Any], chunks: Path) -> None:
        self.manifest = manifest
        self._chunks = chunks
        self._answers: dict[str, tuple[str, dict[str, Any]]] = {}
        self.sessions: dict[str, dict[str, Any]] = {}
        self.runs: list[str] = []
        self.assigned: dict[str, Any] | None = None  # the manifest for one device

    def __call__(self, request: Request) -> Reply:
        path = request.path.removeprefix("/api/v1")
        if "minutes=" in path and self.assigned is not None:
            return Reply(200, self.assigned)
        if path.startswith("/manifest"):
            return Reply(200, self.manifest, (("ETag", '"1"'),))
        if path.startswith("/sequences/"):
            return Reply(200, raw=(self._chunks / Path(path).name).read_bytes())
        if path.startswith("/trajectories/"):
            known = {manifests.digest(manifests.TRAJECTORY): manifests.TRAJECTORY} | room.TRAJECTORIES
            return Reply(200, raw=known[Path(path).name])
        if path == "/enrol":
            return Reply(201, {"installation_id": "me", "token": "secret"})
        if path.startswith("/speedups?"):
            others = [{"device": "a-board", "backend": "opencl", "speedup": 1e-9}]
            return Reply(200, {"results": others, "next": None})
        if request.headers.get("authorization") != "Bearer secret":
            return problem(401, "invalid_token", "unknown token")
        if path == "/submissions":
            return self._submission(request)
        if path.startswith("/submissions/"):
            return Reply(200, {"device": "a-phone", "page": "/mine/signed/", "summarised": True})
        if path == "/me/data":
            return Reply(200, {"sessions": list(self.sessions)})
        if (request.method, path) != ("DELETE", "/me"):
            return problem(404, "not_found", path)
        self.sessions.clear()
        return Reply(204, raw=b"")

    @classmethod
    def with_chunks(cls, folder: Path, manifest: dict[str, Any]) -> "Counting":
        """With a sequence of CHUNKS, which are written into `folder`, for measurements that are canned."""
        for chunk in CHUNKS:
            (folder / manifests.digest(chunk)).write_bytes(chunk)
        return cls(manifest, folder)

    def _submission(self, request: Request) -> Reply:
        key, digest = request.headers["idempotency-key"], hashlib.sha256(request.body).hexdigest()
        if key in self._answers:
            seen, answer = self._answers[key]
            if seen != digest:
                return problem(409, "idempotency_key_reused", "another body under this key")
            return Reply(200, answer)
        items = []
        for session in json.loads(gzip.decompress(request.body))["sessions"]:
            self.sessions[session["id"]] = session
            for run in session["runs"]:
                state = "duplicate" if run["id"] in self.runs else "accepted"
                items.append({"id": run["id"], "status": state, "code": None})
                self.runs.append(run["id"])
        answer = {"submission_id": f"submission {len(self._answers)}", "items": items}
        self._answers[key] = digest, answer
        return Reply(202, answer)
