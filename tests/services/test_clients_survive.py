"""Many clients at once against a real server, over a network that loses and makes up answers."""

import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from client_kit.delivery import sending
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.spool import Spool
from client_kit.home import Home
from tests.client_kit import canned
from tests.client_kit.faulty import Faulty
from tests.client_kit.scripted import Reply, Request, ScriptedServer
from tests.services.serving import Serving
from tests.waiting import until

CLIENTS = 16
AT_ONCE = 8
SHARE = 0.3
MOST_PASSES = 60


def passing_on(server: str, request: Request) -> Reply:
    """`request` as a proxy passes it on, and what `server` answers."""
    kept = {name: value for name, value in request.headers.items() if name not in ("host", "connection")}
    passed = urllib.request.Request(
        server + request.path, data=request.body or None, headers=kept, method=request.method
    )
    try:
        with urllib.request.urlopen(passed) as response:
            return Reply(response.status, raw=response.read())
    except urllib.error.HTTPError as error:
        with error:
            return Reply(error.code, raw=error.read(), headers=(("Retry-After", "0"),))


def test_every_session_is_counted_once_whatever_the_network_does(
    tmp_path: Path, shared_server: Serving
) -> None:
    def devices() -> dict[str, Any]:
        _, answer = shared_server.call("GET", "/api/v1/devices")
        return {device["slug"]: device for device in answer["results"]}

    before = devices()
    asked = Manifest.parse(shared_server.call("GET", "/api/v1/manifest")[1])
    faulty = Faulty(lambda request: passing_on(shared_server.url, request), SHARE, seed=2)
    proxy = ScriptedServer(faulty)

    def client(number: int) -> str:
        home = Home(tmp_path / str(number))
        home.prepare()
        spool = Spool(home.spool)
        item = spool.put(proxy.url, canned.payload(asked, seed=number))
        for _ in range(MOST_PASSES):
            sending.deliver(spool, home)
            if not sending.waiting(spool):
                break
        return spool.item(item.id).state

    with ThreadPoolExecutor(AT_ONCE) as pool:
        states = set(pool.map(client, range(CLIENTS)))
    proxy.close()
    until(lambda: shared_server.waiting() == 0)

    assert states <= {"accepted", "duplicate"}
    assert sum(faulty.harmed.values()) > CLIENTS / 4
    [device] = [each for slug, each in devices().items() if slug not in before]
    assert (device["sessions"], device["installations"]) == (CLIENTS, CLIENTS)
