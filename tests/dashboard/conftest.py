from tests.crowd.conftest import front, join, pack, participant

__all__ = ["front", "join", "pack", "participant"]
