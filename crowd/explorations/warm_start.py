"""What an earlier exploration measured, copied into a new one that starts from it."""

from crowd.explorations import search
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.search import COPIED, FINISHED

ALIKE = ("reference_device_id", "sequence_sha256", "frames")
COPIED_FIELDS = (
    *("label", "configuration", "configuration_key", "frames", "state", "objectives", "stages", "device"),
    *("software", "error", "worker", "finished_at"),
)


def copies(exploration: Exploration, earlier: Exploration) -> list[Evaluation]:
    """What EARLIER measured is known: as if measured here where nothing differs, else as a prior.

    Rows for EXPLORATION, numbered from 0 and not stored.
    """
    alike = all(getattr(earlier, name) == getattr(exploration, name) for name in ALIKE)
    space = search.space_of(exploration)
    found = earlier.evaluations.filter(state__in=FINISHED).exclude(phase__in=COPIED)
    rows = [row for row in found if row.frames == earlier.frames]
    return [
        Evaluation(
            exploration=exploration,
            number=number,
            phase=Evaluation.Phase.KNOWN if alike else Evaluation.Phase.PRIOR,
            index=search.place_of(space, row.configuration),
            copied_from=row,
            **{name: getattr(row, name) for name in COPIED_FIELDS},
        )
        for number, row in enumerate(rows)
    ]


def check(exploration: Exploration, earlier: Exploration) -> None:
    """Raise ParetoError where no explorer can begin with what EARLIER measured. Nothing is learnt for it."""
    rows = copies(exploration, earlier)
    told = [row for row in rows if row.phase == Evaluation.Phase.PRIOR and row.index is not None]
    pairs = [(row.configuration, row.objectives) for row in told]
    search.fresh(exploration, **search.prior(exploration, pairs))
