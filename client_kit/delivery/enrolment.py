"""The anonymous installations of this client on servers: their tokens, and pending erasures.

An installation is one device. If a folder moves to another device, or several share it, each device has its
own installation on a server.
"""

from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, replace

from client_kit.delivery.server import LONGEST_WAIT_SECONDS, ProblemError, Server
from client_kit.home import Home

_DOCUMENT = "installations.json"
# The server no longer has the token's installation: nothing is left to erase there.
GONE = (401, 404, 410)


@dataclass(frozen=True)
class Enrolment:
    """One installation on one server. `erase`: its data must still be erased there; the next request waits
    until `not_before` (seconds since the epoch)."""

    server: str
    installation_id: str
    token: str
    erase: bool
    not_before: float = 0.0

    def pause(self, now: float) -> float:
        """Seconds until the server may be asked again. A longer time than any server asks for comes from a
        clock that was set back, and counts as 0."""
        left = self.not_before - now
        return left if 0 < left <= LONGEST_WAIT_SECONDS else 0.0


def all_enrolments(home: Home) -> list[Enrolment]:
    """All installations of this client; of those on one server, the one that is used first."""
    return [Enrolment(**document) for documents in home.read(_DOCUMENT).values() for document in documents]


def current_token(home: Home, server: Server) -> str | None:
    """The token for a server where this client is enrolled without a pending erasure, else None."""
    return next(iter(_tokens(home, server)), None)


def token(home: Home, server: Server, consent_version: int, another_than: Collection[str] = ()) -> str:
    """The token for a server, after enrolling there if necessary. Raises the server's errors.

    `another_than`: tokens of installations that belong to other devices. Pending erasures are delivered
    first: the new installation is not linked to the old one. Only the process that holds the lock "delivery"
    may call this, or anything else that writes here.
    """
    for token in _tokens(home, server):
        if token not in another_than:
            return token
    while deliver_erasure(home, server):
        pass
    installation_id, new = server.enrol(consent_version)
    _put_first(home, Enrolment(server.url, installation_id, new, erase=False))
    return new


def prefer(home: Home, server: Server, token: str) -> None:
    """Try the installation with `token` first from now on: it belongs to this device."""
    if token != current_token(home, server):
        for enrolment in all_enrolments(home):
            if enrolment.server == server.url and enrolment.token == token:
                _put_first(home, enrolment)


def _tokens(home: Home, server: Server) -> list[str]:
    return [one.token for one in all_enrolments(home) if one.server == server.url and not one.erase]


def renew(home: Home, server: Server) -> bool:
    """Replace the tokens for a server; False without any.

    An old token ends with the first use of the new one, which is stored before that. A process killed in
    between therefore loses no access. Raises the server's errors.
    """
    enrolments = [one for one in all_enrolments(home) if one.server == server.url and not one.erase]
    for enrolment in enrolments:
        new = server.renew_token(enrolment.token)
        _store(home, replace(enrolment, token=new))
        server.own_data(new)
    return bool(enrolments)


def forget(home: Home, enrolment: Enrolment) -> None:
    """Drop an installation."""
    _write(home, enrolment.server, _but(home, enrolment))


def forget_token(home: Home, server: Server, token: str) -> None:
    """Drop the installation with `token`, which the server no longer knows."""
    for enrolment in all_enrolments(home):
        if enrolment.server == server.url and enrolment.token == token:
            forget(home, enrolment)


def request_erasure(home: Home) -> list[str]:
    """Mark every installation for erasure; return their servers."""
    enrolments = all_enrolments(home)
    for enrolment in enrolments:
        _store(home, replace(enrolment, erase=True))
    return [enrolment.server for enrolment in enrolments]


def postpone_erasure(home: Home, enrolment: Enrolment, not_before: float) -> None:
    """Record when the server may be asked again to erase."""
    _store(home, replace(enrolment, not_before=not_before))


def deliver_erasure(home: Home, server: Server) -> bool:
    """Have the server erase one installation marked for erasure; return whether there was one.

    The mark stays until the server has confirmed. Raises the server's errors.
    """
    for enrolment in all_enrolments(home):
        if enrolment.server == server.url and enrolment.erase:
            try:
                server.erase(enrolment.token)
            except ProblemError as problem:
                if problem.status not in GONE:
                    raise
            forget(home, enrolment)
            return True
    return False


def _store(home: Home, enrolment: Enrolment) -> None:
    """Replace the installation with the same id, in its place."""
    present = [one for one in all_enrolments(home) if one.server == enrolment.server]
    same = [enrolment if one.installation_id == enrolment.installation_id else one for one in present]
    _write(home, enrolment.server, same)


def _put_first(home: Home, enrolment: Enrolment) -> None:
    _write(home, enrolment.server, [enrolment, *_but(home, enrolment)])


def _but(home: Home, enrolment: Enrolment) -> list[Enrolment]:
    """The other installations on the same server."""
    return [
        one
        for one in all_enrolments(home)
        if one.server == enrolment.server and one.installation_id != enrolment.installation_id
    ]


def _write(home: Home, server: str, enrolments: Iterable[Enrolment]) -> None:
    """Store exactly `enrolments` for `server`, the one that is used first in front."""
    documents = [asdict(enrolment) for enrolment in enrolments]
    content = {address: others for address, others in home.read(_DOCUMENT).items() if address != server}
    home.write(_DOCUMENT, content | ({server: documents} if documents else {}))
