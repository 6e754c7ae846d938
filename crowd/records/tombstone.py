"""What was erased."""

from datetime import datetime
from typing import Annotated
from uuid import UUID

from crowd.records.record import Record
from wire.meaning import means


class Erased(Record, frozen=True, kw_only=True):
    """A tombstone, as a row of the open data."""

    tombstone: Annotated[UUID, means("random id")]
    kind: Annotated[str, means("run, session or installation")]
    erased_at: Annotated[datetime, means("when, rounded down to the hour (UTC)")]
    id_sha256: Annotated[str, means("SHA-256 of the run's or session's id; empty for an installation")]
    single: Annotated[bool, means("a run that its participant deleted individually")]
