"""How far visitors of /measure/ came: daily counts by words from lists. Nothing identifies anybody."""

from datetime import UTC, datetime
from typing import Literal

import msgspec
from django.db import transaction
from django.db.models import F

from crowd.devices.drivers import BROWSERS
from crowd.devices.models import BrowserAttempt

OTHER = "other"
MOST_ROWS = 500  # of a day, after which devices and browsers are not told apart
# adapter.info.vendor, as Chromium and Safari write it.
GPU_VENDORS = frozenset(
    {
        "amd", "apple", "arm", "google", "img-tec", "intel", "mesa", "microsoft", "nvidia", "qualcomm",
        "samsung",
    }
)  # fmt: skip
GPU_ARCHITECTURES = frozenset(
    {
        "adreno-4xx", "adreno-5xx", "adreno-6xx", "adreno-7xx", "adreno-8xx", "ampere", "bifrost",
        "blackwell", "gen-8", "gen-9", "gen-11", "gen-12hp", "gen-12lp", "hopper", "lovelace", "maxwell",
        "metal-3", "metal-4", "midgard", "pascal", "rdna-1", "rdna-2", "rdna-3", "rdna-4", "rogue",
        "swiftshader", "turing", "valhall", "xe", "xe-2",
    }
)  # fmt: skip

Step = Literal["opened", "refused", "began", "failed", "finished", "unsupported"]
Reason = Literal[
    "no_webgpu", "insecure", "no_adapter", "wrong_results", "device_lost", "does_not_fit", "hidden", "error",
    "declined",
]  # fmt: skip


class Attempt(msgspec.Struct):
    """One step of a visitor of /measure/. Words that the server does not know count as other."""

    step: Step
    reason: Reason | None = None
    gpu_vendor: str | None = None
    gpu_architecture: str | None = None
    browser: str | None = None


def count(attempt: Attempt) -> None:
    """Add one to today's count of what ATTEMPT says."""
    row = {
        "day": datetime.now(UTC).date(),
        "step": attempt.step,
        "reason": attempt.reason or "",
        "gpu_vendor": _listed(attempt.gpu_vendor, GPU_VENDORS),
        "gpu_architecture": _listed(attempt.gpu_architecture, GPU_ARCHITECTURES),
        "browser": _listed(attempt.browser, BROWSERS),
    }
    with transaction.atomic():
        today = BrowserAttempt.objects.filter(day=row["day"])
        if not today.filter(**row).exists() and today.count() >= MOST_ROWS:
            row |= dict.fromkeys(("gpu_vendor", "gpu_architecture", "browser"), OTHER)
        BrowserAttempt.objects.bulk_create([BrowserAttempt(**row)], ignore_conflicts=True)
        BrowserAttempt.objects.filter(**row).update(attempts=F("attempts") + 1)


def _listed(word: str | None, words: frozenset[str]) -> str:
    if not word:
        return ""
    return word if word in words else OTHER
