"""Sending what the spool holds: each session once, in its own request, whatever happened to the others."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from client_kit import enrolment
from client_kit.errors import OutdatedError, UsageError
from client_kit.home import Home
from client_kit.server import NotFrontrunnerError, ProblemError, Server, ServerError
from client_kit.spool import ACCEPTED, DUPLICATE, REJECTED, WAITING, Item, Spool

# What a server says of a request's content: the same request will never be taken.
FINAL = (400, 409, 413, 415, 422)


@dataclass
class Delivery:
    """What became of one pass over the spool. `trouble` says why a server's sessions still wait; `busy`
    that another process is sending; `outdated` that a server refuses this version of the client."""

    settled: list[Item] = field(default_factory=list)
    trouble: dict[str, str] = field(default_factory=dict)
    erased: list[str] = field(default_factory=list)
    busy: bool = False
    outdated: OutdatedError | None = None

    def lines(self) -> list[str]:
        """What became of the sessions, for the participant."""
        lines = []
        for item in self.settled:
            line = f"Session {item.id[:8]}: {item.state} by {item.server}"
            lines.append(f"{line} ({item.reason})" if item.reason else line)
        lines += [f"Erased at {address}." for address in self.erased]
        for address, reason in self.trouble.items():
            lines.append(f"Not sent: {reason}" if address in reason else f"Not sent to {address}: {reason}")
            lines.append("What is to be sent is kept on this device and goes with the next `run` or `send`.")
        if self.busy:
            lines.append("Another client is sending from the same folder: `send` again when it is done.")
        return lines


def deliver(
    spool: Spool,
    home: Home,
    *,
    eager: bool = True,
    connect: Callable[[str], Server] = Server,
    clock: Callable[[], float] = time.time,
) -> Delivery:
    """Send every session that is due, oldest first, and every erasure that still waits.

    A session that the server rejects is marked with its reason and the next one goes on. A server that
    cannot be reached, or asks to wait, is left alone until the next pass; other servers are still served.
    `eager` disregards this client's own pauses, as somebody who asks to send now expects.
    """
    delivery = Delivery()
    with home.only_one("delivery") as alone:
        if not alone:
            delivery.busy = True
            return delivery
        spool.recover()
        _deliver_erasures(home, connect, delivery)
        for item in spool.items():
            if item.server in delivery.trouble or not item.due(clock(), eager=eager):
                continue
            try:
                server = connect(item.server)
                _send(spool, home, server, item)
            except OutdatedError as error:
                spool.postpone(item, str(error))
                delivery.outdated = error
                delivery.trouble[item.server] = str(error)
            except (ServerError, UsageError) as error:
                retry_after = error.retry_after if isinstance(error, ProblemError) else None
                spool.postpone(item, str(error), retry_after)
                delivery.trouble[item.server] = str(error)
            else:
                delivery.settled.append(spool.item(item.id))
    return delivery


def waiting(spool: Spool) -> list[Item]:
    """The sessions that no server has answered for yet."""
    return [item for item in spool.items() if item.state in WAITING]


def _deliver_erasures(home: Home, connect: Callable[[str], Server], delivery: Delivery) -> None:
    for known in enrolment.known(home):
        if known.erase:
            try:
                enrolment.deliver_erasure(home, connect(known.server))
            except (ServerError, OutdatedError) as error:
                delivery.trouble[known.server] = str(error)
            else:
                delivery.erased.append(known.server)


def _send(spool: Spool, home: Home, server: Server, item: Item) -> None:
    """Send one session and settle it. Raises what leaves it waiting."""
    body = spool.body(item)
    payload = spool.payload(item)
    if body is None or payload is None:
        return
    consent_version = payload["consent_version"]
    spool.mark_sending(item)
    try:
        token = enrolment.token(home, server, consent_version)
        try:
            answer = server.submit(token, item.idempotency_key, body)
        except ProblemError as problem:
            if problem.status != 401:
                raise
            # The server does not know this installation any more, after a reset for instance. The ids of
            # the runs keep it from counting twice what it may still have.
            enrolment.forget(home, server.url)
            token = enrolment.token(home, server, consent_version)
            answer = server.submit(token, item.idempotency_key, body)
    except ProblemError as problem:
        if problem.status not in FINAL:
            raise
        spool.settle(item, REJECTED, str(problem))
    else:
        state, reason = _verdict(answer)
        spool.settle(item, state, reason, str(answer["submission_id"]))


def _verdict(answer: dict[str, Any]) -> tuple[str, str | None]:
    """The state of a session from the answers to its runs, and the reasons of those that were not taken.

    One accepted run makes it accepted; else one duplicate makes it duplicate.
    """
    try:
        states = [str(item["status"]) for item in answer["items"]]
        reasons = [f"{item['status']}: {item['code']}" for item in answer["items"] if item.get("code")]
        answer["submission_id"]
    except (KeyError, TypeError) as error:
        raise NotFrontrunnerError(f"the answer to a submission is not understood: {error}") from error
    reason = "; ".join(dict.fromkeys(reasons)) or None
    for state in (ACCEPTED, DUPLICATE, REJECTED):
        if state in states:
            return state, reason
    raise NotFrontrunnerError(f"the answer to a submission tells nothing of its runs: {answer}")
