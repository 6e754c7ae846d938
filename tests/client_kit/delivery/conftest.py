import pytest

from client_kit.delivery.spool import Spool
from client_kit.home import Home
from tests.client_kit.delivery.outbox import Outbox
from tests.client_kit.scripted import Serve


@pytest.fixture
def outbox(home: Home, spool: Spool, serve: Serve) -> Outbox:
    """An empty one."""
    return Outbox(home, spool, serve)
