"""The installations that measured one chip, and how many of their networks agree with one model's figure."""

from collections import defaultdict
from collections.abc import Iterable

from crowd.results.figures import statistics


class ChipPool:
    """MEASURED: device, network ("" where unknown) and mean log ratio of each installation.

    What one network measured on other models is one value, however many installations and models that are:
    an answer takes no longer where one network invents many.
    """

    def __init__(self, measured: Iterable[tuple[int, str, float]]) -> None:
        self._own: dict[int, list[tuple[str, float]]] = defaultdict(list)
        self._sums: dict[str, tuple[float, int]] = {}
        self._unknown: list[tuple[int, float]] = []
        for device, network, log in measured:
            self._own[device].append((network, log))
            if network:
                total, count = self._sums.get(network, (0.0, 0))
                self._sums[network] = total + log, count + 1
            else:
                self._unknown.append((device, log))

    def networks(self, device: int) -> set[str]:
        """The known networks that measured DEVICE."""
        return {network for network, _ in self._own.get(device, ()) if network}

    def witnesses(self, device: int) -> int:
        """How many independent networks agree with the figure of DEVICE."""
        own = self._own.get(device, [])
        sums = dict(self._sums)
        for network, log in own:
            if network:
                total, count = sums[network]
                sums[network] = total - log, count - 1
        others = [(network, total / count) for network, (total, count) in sums.items() if count]
        others += [("", log) for key, log in self._unknown if key != device]
        values = own + others
        return statistics.witnesses(
            [network or None for network, _ in values],
            [log for _, log in values],
            [True] * len(own) + [False] * len(others),
        )
