"""The anonymous installations by which servers know this client: their tokens, and what is to be erased."""

from dataclasses import dataclass

from client_kit.home import Home
from client_kit.server import ProblemError, Server

_DOCUMENT = "installations.json"
# The token names an installation that the server no longer has: nothing is left to erase there.
_GONE = (401, 404, 410)


@dataclass(frozen=True)
class Enrolment:
    """One installation on one server; `erase` when its data there is to be erased."""

    server: str
    installation_id: str
    token: str
    erase: bool


def known(home: Home) -> list[Enrolment]:
    """All installations of this client."""
    documents = home.read(_DOCUMENT).items()
    return [Enrolment(server, d["installation_id"], d["token"], d["erase"]) for server, d in documents]


def token(home: Home, server: Server, consent_version: str | int) -> str:
    """The token for a server, after enrolling there if need be. Raises the server's errors.

    What was to be erased there is erased first: the new installation has nothing to do with the old one.
    """
    for enrolment in known(home):
        if enrolment.server == server.url and not enrolment.erase:
            return enrolment.token
    deliver_erasure(home, server)
    installation_id, new = server.enrol(consent_version)
    _store(home, Enrolment(server.url, installation_id, new, erase=False))
    return new


def forget(home: Home, server: str) -> None:
    """Drop the installation on a server."""
    documents = home.read(_DOCUMENT)
    documents.pop(server, None)
    home.write(_DOCUMENT, documents)


def request_erasure(home: Home) -> list[str]:
    """Note for every installation that its data is to be erased; the servers concerned."""
    enrolments = known(home)
    for enrolment in enrolments:
        _store(home, Enrolment(enrolment.server, enrolment.installation_id, enrolment.token, erase=True))
    return [enrolment.server for enrolment in enrolments]


def deliver_erasure(home: Home, server: Server) -> bool:
    """Have the server erase what is to be erased there; whether there was anything.

    The request is kept until the server has confirmed it. Raises the server's errors.
    """
    for enrolment in known(home):
        if enrolment.server == server.url and enrolment.erase:
            try:
                server.erase(enrolment.token)
            except ProblemError as problem:
                if problem.status not in _GONE:
                    raise
            forget(home, server.url)
            return True
    return False


def _store(home: Home, enrolment: Enrolment) -> None:
    document = {
        "installation_id": enrolment.installation_id,
        "token": enrolment.token,
        "erase": enrolment.erase,
    }
    home.write(_DOCUMENT, {**home.read(_DOCUMENT), enrolment.server: document})
