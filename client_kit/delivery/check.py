"""`check`: any client's payloads against a server's dry run, for authors of other clients."""

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from client_kit.delivery import manifest
from client_kit.delivery.server import ProblemError, Server
from client_kit.errors import ClientError, UsageError
from client_kit.home import Home


@dataclass(frozen=True)
class Verdict:
    """A server's verdict on one payload: `items` are its runs, `judged` the states of configurations;
    `refusal` is of the whole payload."""

    path: Path
    items: Sequence[dict[str, Any]] = ()
    judged: Sequence[dict[str, Any]] = ()
    refusal: str | None = None

    @property
    def conforms(self) -> bool:
        """Whether every run would be accepted."""
        return self.refusal is None and all(item.get("status") != "rejected" for item in self.items)

    def lines(self) -> Iterator[str]:
        """The verdict, with a line for each rejected run and for each configuration."""
        if self.refusal is not None:
            yield f"{self.path}: refused: {self.refusal}"
            return
        taken = sum(item.get("status") != "rejected" for item in self.items)
        yield f"{self.path}: {taken} of {len(self.items)} runs would be accepted"
        for item in self.items:
            if item.get("status") == "rejected":
                yield f"  {item.get('id')}: {item.get('code')} at {item.get('field')}: {item.get('detail')}"
        several = len({one.get("session") for one in self.judged}) > 1
        for one in self.judged:
            name = f"{one.get('configuration')} of {one['session']}" if several else one.get("configuration")
            reason = f" ({one['reason']}: {one.get('meaning')})" if one.get("reason") else ""
            yield f"  {name}: {one.get('state')}{reason}"


def check(paths: Sequence[Path], server: Server, home: Home, token: str | None = None) -> list[Verdict]:
    """Have the server check each file, a body of POST /submissions as JSON; it stores nothing.

    Without a token an installation is enrolled for this, and erased afterwards. Raises UsageError for a
    file that cannot be read, and the server's errors.
    """
    bodies = [_read(path) for path in paths]
    if token is not None:
        return [_judge(path, body, server, token) for path, body in zip(paths, bodies, strict=True)]
    asked, _ = manifest.fetch(server, home)
    _, trial_token = server.enrol(asked.consent_version)
    try:
        verdicts = [_judge(path, body, server, trial_token) for path, body in zip(paths, bodies, strict=True)]
    except BaseException:
        with suppress(ClientError):  # the first error is the one to report
            server.erase(trial_token)
        raise
    server.erase(trial_token)
    return verdicts


def _read(path: Path) -> bytes:
    try:
        body = path.read_bytes()
        json.loads(body)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UsageError(f"{path} is not JSON: {error}") from error
    return body


def _judge(path: Path, body: bytes, server: Server, token: str) -> Verdict:
    try:
        return Verdict(path, *server.validate(token, body))
    except ProblemError as problem:
        if problem.temporary or problem.status == 401:
            raise
        return Verdict(path, refusal=f"{problem} at {problem.field}" if problem.field else str(problem))
