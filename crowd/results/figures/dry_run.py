"""What the server would say of the configurations of a submission that is not stored."""

from collections import defaultdict
from datetime import UTC
from typing import NamedTuple
from uuid import UUID

from crowd.devices.naming import computing
from crowd.devices.naming.chips import CPU
from crowd.devices.naming.identity import EMULATOR, identity_of
from crowd.devices.naming.raw_device import RawDevice
from crowd.results.figures.sessions import front_of
from crowd.results.intake import packing, storing
from crowd.results.intake.admission import CheckedSubmission, Item
from crowd.results.validity.rules import NO_PAIR, RULES, Rule
from crowd.results.validity.runs import READ_COLUMNS, SessionContext, StoredRun, judge_alone
from crowd.results.validity.sessions import SessionInput, summarise


class Judgement(NamedTuple):
    """The state of a configuration in a session, and the rule that applies; None if it is valid."""

    session: UUID
    configuration: str
    rule: Rule | None


def judge(checked: CheckedSubmission, installation: UUID) -> list[Judgement]:
    """The judgements of all configurations of `checked`, from its accepted runs alone.

    Rules that compare with other sessions do not apply. No queries.
    """
    accepted: dict[UUID, list[Item]] = defaultdict(list)
    for item in checked.items:
        if item.rejection is None:
            accepted[item.session.id].append(item)
    device = RawDevice.parse(checked.submission.device)
    processor = computing.processor_of(device)
    emulated = identity_of(device, processor).kind == EMULATOR
    fronts = {slug: front_of(front.row) for slug, front in checked.fronts.items()}
    judgements = []
    for uuid, items in accepted.items():
        session = items[0].session
        front = fronts[session.front_version]
        names = {one.pk: name for name, one in checked.fronts[session.front_version].configurations.items()}
        runs = [_run(item, checked, key) for key, item in enumerate(items)]
        runs.sort(key=lambda run: (run.repeat, run.pk))
        judge_alone(runs, {0: SessionContext(installation, front)})
        day = session.started_at.astimezone(UTC).date()
        on_processor = session.backend in computing.ON_PROCESSOR or processor.kind == CPU
        as_stored = SessionInput(
            0, 0, installation, session.started_at, day, front, on_processor, emulated, released=False
        )
        rules = {row.configuration_id: row.reason for row in summarise([as_stored], {0: runs})}
        for key in dict.fromkeys(run.configuration_id for run in runs):
            if key == front.baseline:
                own = (run.reason for run in runs if run.configuration_id == key)
                reason = next(filter(None, own), "")
            else:
                reason = rules.get(key, NO_PAIR.code)
            judgements.append(Judgement(uuid, names[key], RULES.get(reason)))
    return judgements


def _run(item: Item, checked: CheckedSubmission, key: int) -> StoredRun:
    """The run of `item` as it would be stored, with `key`, in the session 0."""
    row = storing.run_row(item, checked.fronts[item.session.front_version])
    row.pk, row.session_id = key, 0
    series = packing.decompress(storing.frames_row(item, row).content)
    return StoredRun(series, *(getattr(row, name) for name in READ_COLUMNS))
