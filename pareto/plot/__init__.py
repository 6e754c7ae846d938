"""Pictures of an exploration: pure functions from an explorer to a figure, and one page of all of them."""

from pareto.plot.page import save

__all__ = ["save"]
