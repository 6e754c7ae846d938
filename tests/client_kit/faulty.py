"""A network between client and server that loses, breaks off and makes up answers."""

import random
import threading
from collections.abc import Callable

from tests.client_kit.scripted import Reply, Request, problem

Answer = Callable[[Request], Reply]


class Faulty:
    """Passes requests on to `answer`, and harms a share `share` of them in one of the ways a network does.

    Some never arrive, others arrive and are carried out while their answer is lost: a client cannot tell
    which. `harmed` counts each kind.
    """

    def __init__(self, answer: Answer, share: float, seed: int) -> None:
        self._answer, self._share = answer, share
        self._chance, self._lock = random.Random(seed), threading.Lock()
        self.harmed: dict[str, int] = {}

    def __call__(self, request: Request) -> Reply:
        with self._lock:
            kinds = [self._dropped, self._lost, self._cut, self._refused, self._foreign]
            harm = self._chance.choice(kinds) if self._chance.random() < self._share else None
            if harm is None:
                return self._answer(request)
            name = harm.__name__.strip("_")
            self.harmed[name] = self.harmed.get(name, 0) + 1
        return harm(request)

    def _dropped(self, _: Request) -> Reply:
        raise ConnectionResetError  # before anybody saw it

    def _lost(self, request: Request) -> Reply:
        self._one_at_a_time(request)
        raise ConnectionResetError

    def _cut(self, request: Request) -> Reply:
        reply = self._one_at_a_time(request)
        return Reply(reply.status, reply.document, reply.headers, reply.raw, cut=3)

    def _refused(self, request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            return problem(503, "database_unavailable", Retry_After="0")
        return Reply(502, raw=b"<html>Bad gateway")

    def _foreign(self, _: Request) -> Reply:
        return Reply(200, raw=b"<html>Welcome to our hotel")

    def _one_at_a_time(self, request: Request) -> Reply:
        with self._lock:
            return self._answer(request)
