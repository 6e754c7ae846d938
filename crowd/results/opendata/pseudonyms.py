"""Pseudonyms of installations and of their networks, new ones for each export."""

import hashlib
import hmac
import secrets
from typing import IO, Protocol
from uuid import UUID

PSEUDONYM_LENGTH = 16
GROUP_BYTES = 6


class Pseudonyms(Protocol):
    """What the rows of sessions call an installation, and the group of those of its network."""

    def installation(self, session: UUID, installation: UUID) -> str:
        """The pseudonym of `installation`, which measured `session`."""

    def group(self, session: UUID, device: int, front: int, network: str) -> int | None:
        """A number for `network`, the same only within one model and front; None for an unknown network."""


class RandomPseudonyms:
    """Those of a new export. Their key is not stored."""

    def __init__(self) -> None:
        self._key = secrets.token_bytes(32)

    def installation(self, session: UUID, installation: UUID) -> str:  # noqa: ARG002 - the same in all sessions
        """Random, the same in all sessions."""
        return self._digest(str(installation)).hex()[:PSEUDONYM_LENGTH]

    def group(self, session: UUID, device: int, front: int, network: str) -> int | None:  # noqa: ARG002
        """Random, the same in all sessions of the model and front."""
        if not network:
            return None
        return int.from_bytes(self._digest(f"{device} {front} {network}")[:GROUP_BYTES], "big")

    def _digest(self, text: str) -> bytes:
        return hmac.new(self._key, text.encode(), hashlib.sha256).digest()


class EarlierPseudonyms:
    """Those in an earlier file of sessions. A session that the file lacks arrived later: it gets new ones."""

    def __init__(self, sessions: IO[bytes]) -> None:
        import pyarrow.parquet

        columns = pyarrow.parquet.read_table(sessions, columns=["session", "installation", "network_group"])
        self._rows = {row["session"]: row for row in columns.to_pylist()}

    def installation(self, session: UUID, installation: UUID) -> str:  # noqa: ARG002 - looked up by session
        """That of the file."""
        row = self._rows.get(str(session))
        return secrets.token_hex(PSEUDONYM_LENGTH // 2) if row is None else row["installation"]

    def group(self, session: UUID, device: int, front: int, network: str) -> int | None:  # noqa: ARG002
        """That of the file."""
        row = self._rows.get(str(session))
        return None if row is None else row["network_group"]
