"""The order of the runs of a session."""

from collections.abc import Collection

from msgspec.structs import replace

from wire.front import ADAPTIVE, BEST, DEFAULT, Protocol

# What every session measures, forwards and back, so that a steady drift cancels in the pairs.
ORDERS = tuple((*names, *reversed(names)) for names in ((DEFAULT, BEST), (DEFAULT, BEST, ADAPTIVE)))


def session_protocol(protocol: Protocol, names: Collection[str]) -> Protocol:
    """`protocol` with the order for a front with the points `names`: `adaptive` is measured where it is one.

    An order that an administrator wrote stays.
    """
    return replace(protocol, order=ORDERS[ADAPTIVE in names]) if protocol.order in ORDERS else protocol
