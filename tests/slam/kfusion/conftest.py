"""Sessions on every device of every backend."""

from tests.slam.backends import session

__all__ = ["session"]
