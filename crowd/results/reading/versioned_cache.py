"""What many requests read alike, kept by a process for as long as nothing that it was made of changes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class VersionedCache(Generic[T]):
    """At most so many answers, each under the version of the data that it was made of; the one that was asked
    for longest ago goes first.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._held: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = Lock()

    def get(self, version: Callable[[], str], key: Hashable, make: Callable[[], T]) -> T:
        """What MAKE answers for KEY, made again once VERSION answers another text.

        What was read while the version changed may be of either and is not kept.
        """
        before = version()
        with self._lock:
            if (before, key) in self._held:
                self._held.move_to_end((before, key))
                return self._held[before, key]
        made = make()
        if version() == before:
            with self._lock:
                self._held[before, key] = made
                while len(self._held) > self._most:
                    self._held.popitem(last=False)
        return made
