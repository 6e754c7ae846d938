"""Many clients with real spools, over a network that does all a network can do to them."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from client_kit.delivery import sending
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.spool import ACCEPTED, DUPLICATE, Spool
from client_kit.home import Home
from tests.builders import manifests
from tests.client_kit import canned
from tests.client_kit.counting import Counting
from tests.client_kit.faulty import Faulty
from tests.client_kit.scripted import Serve

CLIENTS = 80
AT_ONCE = 16
SHARE = 0.4
MOST_PASSES = 60


@pytest.mark.slow
def test_all_end_with_their_session_counted_exactly_once(tmp_path: Path, serve: Serve) -> None:
    asked = Manifest.parse(manifests.manifest())
    counting = Counting(manifests.manifest(), tmp_path)
    faulty = Faulty(counting, SHARE, seed=1)
    url = serve(faulty).url

    def client(number: int) -> tuple[str, str, int]:
        home = Home(tmp_path / str(number))
        home.prepare()
        spool = Spool(home.spool)
        item = spool.put(url, canned.payload(asked, seed=number))
        passes = 0
        while sending.waiting(spool) and passes < MOST_PASSES:
            sending.deliver(spool, home)
            passes += 1
        return item.id, spool.item(item.id).state, passes

    with ThreadPoolExecutor(AT_ONCE) as pool:
        outcomes = list(pool.map(client, range(CLIENTS)))

    assert {state for _, state, _ in outcomes} <= {ACCEPTED, DUPLICATE}
    assert sorted(counting.sessions) == sorted(session for session, _, _ in outcomes)
    assert len(counting.runs) == 4 * CLIENTS
    assert len(set(counting.runs)) == len(counting.runs)
    # The network did each kind of harm, and most clients needed more than one attempt at something.
    assert len(faulty.harmed) == 5
    assert sum(passes for *_, passes in outcomes) > 1.3 * CLIENTS
