"""What everybody may read of a text that a machine wrote: as `slam.disclosure`, which clients use too."""

from slam.disclosure import public

__all__ = ["public"]
