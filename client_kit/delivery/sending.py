"""Sending the spool: each session once, in its own request, independent of the others."""

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from client_kit.delivery import consent, enrolment
from client_kit.delivery.server import NotFrontrunnerError, ProblemError, Server, ServerError
from client_kit.delivery.spool import ACCEPTED, DUPLICATE, REJECTED, WAITING, Item, Spool
from client_kit.errors import OutdatedError, UsageError
from client_kit.home import Home

# Client errors about a submission's content: the same request will never be accepted.
FINAL = (400, 409, 413, 415, 422)
# Exceptions: the participant may agree to the new consent text, and `renew` then changes the request; and
# another device uses its own installation.
CONSENT_OUTDATED = "consent_outdated"
DEVICE_CHANGED = "device_changed"
# Errors about one submission that may be accepted later: the server's other sessions do not wait for it.
ONE_SUBMISSION = (408, 500)
UUID = re.compile(r"\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b", re.IGNORECASE)


@dataclass
class Delivery:
    """The outcome of one pass over the spool. `trouble`: why a server's sessions still wait; `busy`: another
    process is sending; `outdated`: a server refuses this version of the client."""

    settled: list[Item] = field(default_factory=list)
    trouble: dict[str, str] = field(default_factory=dict)
    erased: list[str] = field(default_factory=list)
    busy: bool = False
    outdated: OutdatedError | None = None

    def lines(self) -> list[str]:
        """The outcome of the sessions, for the participant."""
        lines = []
        for item in self.settled:
            line = f"Session {item.id[:8]}: {item.state} by {item.server}"
            lines.append(f"{line} ({item.reason})" if item.reason else line)
        lines += [f"Erased at {address}." for address in self.erased]
        for address, reason in self.trouble.items():
            lines.append(f"Not sent: {reason}" if address in reason else f"Not sent to {address}: {reason}")
            lines.append("Unsent results are stored on this device and sent by the next `run` or `send`.")
        if self.busy:
            lines.append("Another client is sending from the same folder: use `send` when it is done.")
        return lines


def deliver(
    spool: Spool,
    home: Home,
    *,
    eager: bool = True,
    connect: Callable[[str], Server] = Server,
    clock: Callable[[], float] = time.time,
) -> Delivery:
    """Send every session that is due, oldest first, and every pending erasure. Finished runs of a killed
    client are sent, too.

    A rejected session is marked with its reason, and the next one follows. A server that cannot be reached,
    or asks to wait, is skipped until the next pass; the wait applies to all of its sessions. If it fails
    on one submission, the next one is sent. `eager` ignores this client's own pauses, for an explicit request
    to send.
    """
    delivery = Delivery()
    with home.only_one("delivery") as alone:
        if not alone:
            delivery.busy = True
            return delivery
        _recover(spool, home)
        held = {server for server, left in pauses(waiting(spool), clock(), eager=eager).items() if left}
        _deliver_erasures(spool, home, connect, delivery, held, clock)
        held |= set(delivery.trouble)
        for item in waiting(spool):
            if item.server in held:
                continue
            try:
                server = connect(item.server)
                _send(spool, home, server, item)
            except OutdatedError as error:
                spool.postpone(item, str(error))
                delivery.outdated = error
                delivery.trouble[item.server] = str(error)
                held.add(item.server)
            except (ServerError, UsageError) as error:
                reason = _reason(error)
                spool.postpone(item, reason, _retry_after(error))
                delivery.trouble[item.server] = reason
                held.add(item.server)
            else:
                answered = spool.find(item.id)  # a session erased meanwhile is not there
                if answered and answered.state in WAITING:
                    delivery.trouble[item.server] = answered.reason or ""
                elif answered:
                    delivery.settled.append(answered)
    return delivery


def erase(spool: Spool, home: Home) -> tuple[int, list[str]]:
    """Withdraw every agreement, forget every session and request erasure; return the number of sessions, and
    the servers.

    A process that is sending finds nothing more to send. This waits for it, so an installation that it
    created is erased, too.
    """
    consent.withdraw(home)
    sessions = spool.clear()
    with home.only_one("delivery", wait=True):
        return sessions + spool.clear(), enrolment.request_erasure(home)


def erase_run(spool: Spool, home: Home, run: str) -> list[str]:
    """Erase one run on the servers that have it, then here; return those servers.

    `run` is its id or the address of its page. Waits for a process that is sending. Raises UsageError for
    anything else or an unknown run. Raises ServerError where a server cannot be reached: the run then stays
    here, too.
    """
    run = run_id(run)
    with home.only_one("delivery", wait=True):
        _recover(spool, home)
        item = spool.holding(run)
        erased = []
        for enrolled in enrolment.all_enrolments(home):
            if enrolled.erase or (item is not None and item.server != enrolled.server):
                continue
            try:
                Server(enrolled.server).erase_run(enrolled.token, run)
            except ProblemError as problem:
                if problem.status not in enrolment.GONE:
                    raise
            else:
                erased.append(enrolled.server)
        if item is not None:
            spool.drop(item, run)
        elif not erased:
            raise UsageError(f"--run {run}: neither this device nor its servers have this run")
    return erased


def run_id(text: str) -> str:
    """The id of a run from `text`, an id or the address of its page. Raises UsageError."""
    ids = UUID.findall(text)
    if not ids:
        raise UsageError(f"--run {text}: give the run's id, as in `export`, or its page's address")
    return str(ids[-1]).lower()


def renew_tokens(home: Home, on_renewed: Callable[[str], None] | None = None) -> list[str]:
    """Have every server replace this client's token; return those servers.

    Calls `on_renewed` with each. Waits for a process that is sending. If servers cannot be reached, the
    others are asked first; then the first ServerError or OutdatedError is raised.
    """
    renewed, troubles = [], []
    with home.only_one("delivery", wait=True):
        for address in dict.fromkeys(enrolled.server for enrolled in enrolment.all_enrolments(home)):
            try:
                if not enrolment.renew(home, Server(address)):
                    continue
            except (ServerError, OutdatedError) as error:
                troubles.append(error)
                continue
            renewed.append(address)
            if on_renewed is not None:
                on_renewed(address)
    if troubles:
        raise troubles[0]
    return renewed


def renew(spool: Spool, home: Home, server: str, version: int) -> None:
    """Mark sessions waiting for `server` as agreed to `version` of the consent text.

    Nothing happens while another process sends: the next `run` renews it.
    """
    with home.only_one("delivery") as alone:
        for item in waiting(spool) if alone else ():
            payload = spool.payload(item) if item.server == server else None
            if payload is not None and payload["consent_version"] != version:
                spool.renew(item, {**payload, "consent_version": version})


def pauses(items: Iterable[Item], now: float, *, eager: bool = False) -> dict[str, float]:
    """The seconds until each server of `items` may be asked again, 0 for now."""
    seconds: dict[str, float] = {}
    for item in items:
        left = 0.0 if item.due(now, eager=eager) else item.not_before - now
        seconds[item.server] = max(left, seconds.get(item.server, 0.0))
    return seconds


def waiting(spool: Spool) -> list[Item]:
    """The sessions without an answer from a server."""
    return [item for item in spool.items() if item.state in WAITING]


def _recover(spool: Spool, home: Home) -> None:
    """Queue the sessions of processes that died while sending or measuring. Only the process with the lock
    "delivery" may call this."""
    spool.recover()
    if spool.drafts():
        with home.only_one("measurement") as nobody_measures:
            if nobody_measures:
                spool.queue_drafts()


def _deliver_erasures(
    spool: Spool,
    home: Home,
    connect: Callable[[str], Server],
    delivery: Delivery,
    held: set[str],
    clock: Callable[[], float],
) -> None:
    for enrolled in enrolment.all_enrolments(home):
        if not enrolled.erase or enrolled.server in held:
            continue
        pause = enrolled.pause(clock())
        if pause:
            delivery.trouble[enrolled.server] = f"{enrolled.server} asks to wait for {pause:.0f} s"
            continue
        try:
            enrolment.deliver_erasure(home, connect(enrolled.server))
        except (ServerError, OutdatedError) as error:
            delivery.trouble[enrolled.server] = str(error)
            retry_after = _retry_after(error)
            if retry_after is not None:
                enrolment.postpone_erasure(home, enrolled, clock() + retry_after)
            # Sessions for that server wait for the erasure.
            for item in waiting(spool):
                if item.server == enrolled.server:
                    spool.postpone(item, str(error), retry_after)
        else:
            delivery.erased.append(enrolled.server)


def _send(spool: Spool, home: Home, server: Server, item: Item) -> None:
    """Send one session and record the answer. Raises errors that leave it and the server's others waiting."""
    body = spool.body(item)
    payload = spool.payload(item)
    if body is None or payload is None:
        return
    spool.mark_sending(item)
    forgotten = False
    of_others: list[str] = []  # tokens of installations that belong to other devices
    most = len(enrolment.all_enrolments(home))
    while True:
        # A refusal to enrol is not about the session.
        token = enrolment.token(home, server, payload["consent_version"], another_than=of_others)
        try:
            answer = server.submit(token, item.idempotency_key, body)
        except ProblemError as problem:
            if problem.status == 401 and not forgotten:
                # The server no longer knows this installation, for instance after a reset. The ids of the
                # runs prevent counting them twice.
                enrolment.forget_token(home, server, token)
                forgotten = True
                continue
            if problem.code == DEVICE_CHANGED and len(of_others) < most:
                of_others.append(token)
                continue
            if problem.status in ONE_SUBMISSION and problem.retry_after is None:
                spool.postpone(item, str(problem))
                return
            if problem.status not in FINAL or problem.code in (CONSENT_OUTDATED, DEVICE_CHANGED):
                raise
            spool.settle(item, REJECTED, str(problem))
            return
        enrolment.prefer(home, server, token)
        state, reason = _verdict(answer)
        spool.settle(item, state, reason, str(answer["submission_id"]))
        return


def _reason(error: Exception) -> str:
    if isinstance(error, ProblemError) and error.code == CONSENT_OUTDATED:
        return f"{error}: agree again with `run`"
    return str(error)


def _retry_after(error: Exception) -> float | None:
    return error.retry_after if isinstance(error, ProblemError) else None


def _verdict(answer: dict[str, Any]) -> tuple[str, str | None]:
    """The state of a session from the answers to its runs, and the reasons of rejected ones.

    One accepted run makes it accepted; else one duplicate makes it duplicate.
    """
    try:
        states = [str(item["status"]) for item in answer["items"]]
        reasons = [f"{item['status']}: {item['code']}" for item in answer["items"] if item.get("code")]
        answer["submission_id"]
    except (KeyError, TypeError) as error:
        raise NotFrontrunnerError(f"the answer to a submission is malformed: {error}") from error
    reason = "; ".join(dict.fromkeys(reasons)) or None
    for state in (ACCEPTED, DUPLICATE, REJECTED):
        if state in states:
            return state, reason
    raise NotFrontrunnerError(f"the answer to a submission lacks its runs: {answer}")
