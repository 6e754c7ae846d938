"""The pages of an accepted session, and its comparison with other devices."""

from collections.abc import Callable
from typing import Any

from client_kit.console import Console
from client_kit.delivery import enrolment
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import Server, ServerError
from client_kit.delivery.spool import Item
from client_kit.home import Home
from client_kit.measuring.session import Session
from client_kit.participating import summary

SUMMARY_PATIENCE_SECONDS = 15.0
SUMMARY_PAUSE_SECONDS = 0.5


def show(
    server: Server,
    home: Home,
    session: Session,
    item: Item,
    asked: Manifest,
    console: Console,
    pause: Callable[[float], None],
) -> None:
    """Print the pages of `session`, which was sent as `item`, and the runs that the server does not count."""
    try:
        state = _summarised(server, home, item, pause)
    except ServerError as error:
        console.say(f"The session is accepted; its page could not be requested: {error}")
        return
    aside = set()
    for judged in state.get("sessions") or ():
        for speedup in judged.get("speedups") or ():
            if speedup.get("state") != "valid":
                name, reason = speedup.get("configuration"), speedup.get("reason")
                aside.add(name)
                console.say(f"The server sets {name} aside: {speedup.get('state')}, {reason}")
    own_speedup = summary.best_speedup(session, asked)
    # Only a speedup that counts, of a device with a name on the server, has a rank.
    if own_speedup is not None and own_speedup[0] not in aside and state.get("device"):
        _show_place(server, own_speedup, session.backend, asked, str(state["device"]), console)
    if state.get("page"):
        page = server.page(str(state["page"]))
        console.say(f"Your private page, which names this device (anyone with the link can read it): {page}")
    if state.get("device"):
        console.say(f"Among the others: {server.page('devices/' + str(state['device']) + '/')}")
    else:
        console.say(f"The server has not processed this session yet: {server.page('devices/')}")


def _summarised(server: Server, home: Home, item: Item, pause: Callable[[float], None]) -> dict[str, Any]:
    token = enrolment.current_token(home, server)
    if token is None:  # erased meanwhile; reading a page must not enrol again
        return {}
    waited = 0.0
    while True:
        state = server.submission(token, str(item.submission_id))
        if state.get("summarised") or waited >= SUMMARY_PATIENCE_SECONDS:
            return state
        pause(SUMMARY_PAUSE_SECONDS)
        waited += SUMMARY_PAUSE_SECONDS


def _show_place(
    server: Server, own: tuple[str, float], backend: str, asked: Manifest, device: str, console: Console
) -> None:
    name, speedup = own
    try:
        crowd = server.speedups(asked.front_version, name)
        console.say(summary.rank_line(crowd, speedup, device, backend))
    except (ServerError, KeyError, TypeError, ValueError) as error:
        console.say(f"The rank among other devices could not be requested: {error}")
