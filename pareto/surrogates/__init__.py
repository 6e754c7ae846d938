"""Models that predict what was not measured."""
