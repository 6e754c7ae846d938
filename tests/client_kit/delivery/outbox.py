"""The sessions that wait on a device for their servers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from client_kit.delivery import sending
from client_kit.delivery.sending import Delivery
from client_kit.delivery.spool import Item, Spool
from client_kit.home import Home
from tests.builders import manifests
from tests.client_kit.scripted import Answer, ScriptedServer, Serve, accepting


@dataclass(frozen=True)
class Outbox:
    """A home with its spool, and servers that take what it holds."""

    home: Home
    spool: Spool
    serve: Serve

    def put(self, server: ScriptedServer | str, payload: dict[str, Any] | None = None) -> Item:
        """A session for `server`; an ordinary one unless there is a `payload`."""
        address = server if isinstance(server, str) else server.url
        return self.spool.put(address, manifests.payload() if payload is None else payload)

    def filled(self, answer: Answer = accepting, sessions: int = 1, port: int = 0) -> ScriptedServer:
        """A server that answers so, with that many `sessions` for it."""
        server = self.serve(answer, port)
        for _ in range(sessions):
            self.put(server)
        return server

    def deliver(self, clock: Callable[[], float] | None = None) -> Delivery:
        return sending.deliver(self.spool, self.home, **({} if clock is None else {"clock": clock}))

    def items(self) -> list[Item]:
        return self.spool.items()

    def states(self) -> list[str]:
        return [item.state for item in self.items()]
