"""A point or probe of a published front."""

from datetime import datetime
from typing import Annotated

from crowd.records import shared
from crowd.records.record import Record
from wire.meaning import means


class PublishedConfiguration(Record, frozen=True, kw_only=True):
    """A point or probe of a published front, as a row of the open data. JSON is text."""

    application: shared.Application
    front: shared.Front
    configuration: Annotated[str, means("its name: default, best and others")]
    position: Annotated[int, means("place in the front's list, from 0", arrow="int32")]
    parameters: Annotated[str, means("JSON: name and value of each parameter")]
    predicted: Annotated[str, means("JSON: runtime (s), ate_max (m), ate_mean (m) on the reference device")]
    band: Annotated[float | None, means("a run with a larger deviation does not count", "m")]
    skipped: Annotated[
        float | None,
        means("counted frames that it left out on the reference; empty if it computes all", "share"),
    ]
    probe: Annotated[bool, means("a configuration beside the front: clients measure it only on request")]
    learned_on: Annotated[str, means("JSON: largest error (ate_max, m) and lost frames by sequence")]
    held_out: Annotated[str, means("JSON: the same on sequences that the search did not use")]
    state: Annotated[str, means("published or retired")]
    published_at: Annotated[datetime, means("when clients began to measure it (UTC)")]
