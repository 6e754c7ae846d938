"""The anonymous installations by which servers know this client: their tokens, and what is to be erased."""

from dataclasses import dataclass, replace

from client_kit.home import Home
from client_kit.server import LONGEST_WAIT_SECONDS, ProblemError, Server

_DOCUMENT = "installations.json"
# The token names an installation that the server no longer has: nothing is left to erase there.
GONE = (401, 404, 410)


@dataclass(frozen=True)
class Enrolment:
    """One installation on one server; `erase` when its data there is to be erased, which the server asked
    not to be told again before `not_before` (seconds since the epoch)."""

    server: str
    installation_id: str
    token: str
    erase: bool
    not_before: float = 0.0

    def pause(self, now: float) -> float:
        """For how many seconds the server is to be left alone. A time further off than any that a server
        can ask for comes from a clock that was set back."""
        left = self.not_before - now
        return left if 0 < left <= LONGEST_WAIT_SECONDS else 0.0


def known(home: Home) -> list[Enrolment]:
    """All installations of this client."""
    documents = home.read(_DOCUMENT).items()
    return [
        Enrolment(server, d["installation_id"], d["token"], d["erase"], d.get("not_before", 0.0))
        for server, d in documents
    ]


def present(home: Home, server: Server) -> str | None:
    """The token for a server where this client is enrolled and nothing is to be erased, else None."""
    tokens = (one.token for one in known(home) if one.server == server.url and not one.erase)
    return next(tokens, None)


def token(home: Home, server: Server, consent_version: str | int) -> str:
    """The token for a server, after enrolling there if need be. Raises the server's errors.

    What was to be erased there is erased first: the new installation has nothing to do with the old one.
    Only who holds the lock "delivery" may call this, and whatever else writes here.
    """
    token = present(home, server)
    if token is not None:
        return token
    deliver_erasure(home, server)
    installation_id, new = server.enrol(consent_version)
    _store(home, Enrolment(server.url, installation_id, new, erase=False))
    return new


def renew(home: Home, server: Server) -> bool:
    """Have another token take the place of the one for a server; False where there is none.

    The old one ends with the first use of the new one, which is kept before that: whoever is killed in
    between is locked out of nothing. Raises the server's errors.
    """
    for enrolment in known(home):
        if enrolment.server == server.url and not enrolment.erase:
            new = server.renew_token(enrolment.token)
            _store(home, replace(enrolment, token=new))
            server.own_data(new)
            return True
    return False


def forget(home: Home, server: str) -> None:
    """Drop the installation on a server."""
    documents = home.read(_DOCUMENT)
    documents.pop(server, None)
    home.write(_DOCUMENT, documents)


def request_erasure(home: Home) -> list[str]:
    """Note for every installation that its data is to be erased; the servers concerned."""
    enrolments = known(home)
    for enrolment in enrolments:
        _store(home, replace(enrolment, erase=True))
    return [enrolment.server for enrolment in enrolments]


def postpone_erasure(home: Home, enrolment: Enrolment, not_before: float) -> None:
    """Note when the server may be told again what is to be erased."""
    _store(home, replace(enrolment, not_before=not_before))


def deliver_erasure(home: Home, server: Server) -> bool:
    """Have the server erase what is to be erased there; whether there was anything.

    The request is kept until the server has confirmed it. Raises the server's errors.
    """
    for enrolment in known(home):
        if enrolment.server == server.url and enrolment.erase:
            try:
                server.erase(enrolment.token)
            except ProblemError as problem:
                if problem.status not in GONE:
                    raise
            forget(home, server.url)
            return True
    return False


def _store(home: Home, enrolment: Enrolment) -> None:
    document = {
        "installation_id": enrolment.installation_id,
        "token": enrolment.token,
        "erase": enrolment.erase,
        "not_before": enrolment.not_before,
    }
    home.write(_DOCUMENT, {**home.read(_DOCUMENT), enrolment.server: document})
