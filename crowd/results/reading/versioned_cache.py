"""A cache in the process, whose entries are valid for one version of the data."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class VersionedCache(Generic[T]):
    """Keeps at limit `limit` values, each for one version of the data. The least recently used is dropped."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._held: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = Lock()

    def get(self, version: Callable[[], str], key: Hashable, make: Callable[[], T]) -> T:
        """The value of `key` in the current version, from `make` if it is not cached.

        A value that was made while the version changed is not cached.
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
                while len(self._held) > self._limit:
                    self._held.popitem(last=False)
        return made
