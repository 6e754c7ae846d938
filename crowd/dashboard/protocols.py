"""The members of a front's protocol that pages show."""

from crowd.fronts.protocol import first_counted_frame, max_ate

__all__ = ["first_counted_frame", "max_ate"]
