"""Daily counts of visitors of the measuring page, and of how far they came.

A count belongs to a day, a step, a reason, the maker and architecture of a graphics chip, and a browser. Only
listed words are stored; all others are counted as OTHER. Addresses and times of day are not stored.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, get_args

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import F, QuerySet, Sum

from crowd.devices.models import AttemptCount
from crowd.devices.naming.chips import OTHER, listed_words
from crowd.devices.naming.computing import listed_browser

# Combinations per day that get their own row; later ones are counted under OTHER.
MOST_ROWS = 300

Text = Annotated[str, msgspec.Meta(max_length=200)]
Step = Literal["opened", "unsupported", "began", "failed", "finished"]
Reason = Literal[
    "no_wasm_simd",
    "insecure",
    "wrong_results",
    "device_lost",
    "does_not_fit",
    "no_answer",
    "hidden",
    "stopped",
    "error",
]
WITH_REASON = frozenset({"failed", "unsupported"})


class Attempt(msgspec.Struct):
    """How far a browser came, why it stopped, and its graphics chip. It does not identify the visitor."""

    step: Step
    reason: Reason | None = None
    gpu_vendor: Text | None = None
    gpu_architecture: Text | None = None
    browser: Text | None = None


DECODER = msgspec.json.Decoder(Attempt)


def count(attempt: Attempt) -> None:
    """Increment the count of `attempt`'s day, step, reason, chip and browser."""
    vendor, architecture = listed_words(_one_line(attempt.gpu_vendor), _one_line(attempt.gpu_architecture))
    day = datetime.now(UTC).date()
    key: dict[str, object] = {
        "day": day,
        "step": attempt.step,
        "reason": (attempt.reason or "") if attempt.step in WITH_REASON else "",
    }
    details: dict[str, object] = {
        "gpu_vendor": vendor,
        "gpu_architecture": architecture,
        "browser": listed_browser(_one_line(attempt.browser)),
    }
    if _increment(key | details):
        return
    if AttemptCount.objects.filter(day=day).count() >= MOST_ROWS:
        details = dict.fromkeys(details, OTHER)
    try:
        with transaction.atomic():
            AttemptCount.objects.create(**key, **details, count=1)
    except IntegrityError:
        # Another request created the row first, or the row of OTHER exists.
        _increment(key | details)


@dataclass(frozen=True)
class Summary:
    """Sums over some days, largest first.

    `steps`: per step. `reasons`: per step and reason. `wrong_results`: per chip and browser that computed
    wrong results.
    """

    steps: tuple[tuple[str, int], ...]
    reasons: tuple[tuple[Any, ...], ...]
    wrong_results: tuple[tuple[Any, ...], ...]


def summary(rows: "QuerySet[AttemptCount]") -> Summary:
    """The sums over `rows` that administrators see. Three queries."""
    steps = dict(_sums(rows, "step"))
    stopped = rows.filter(step__in=WITH_REASON)
    wrong = rows.filter(reason="wrong_results")
    return Summary(
        tuple((step, steps.get(step, 0)) for step in get_args(Step)),
        _sums(stopped, "step", "reason"),
        _sums(wrong, "gpu_vendor", "gpu_architecture", "browser"),
    )


def _sums(rows: "QuerySet[AttemptCount]", *by: str) -> tuple[tuple[Any, ...], ...]:
    return tuple(rows.order_by().values_list(*by).annotate(sum=Sum("count")).order_by("-sum", *by))


def _increment(key: dict[str, object]) -> bool:
    return bool(AttemptCount.objects.filter(**key).update(count=F("count") + 1))


def _one_line(text: str | None) -> str:
    return " ".join((text or "").split())
