"""Deletes recommendations after erasures. Every process imports this module, so it does not import pandas."""

from collections.abc import Iterable

from crowd.predictions.models import Recommendation
from crowd.results.figures.cohorts import cohort_key
from crowd.results.models import Cohort


def forget_erased(cohorts: Iterable[Cohort], **_: object) -> None:
    """Delete the recommendations for `cohorts`: they may depend on erased measurements."""
    for cohort in cohorts:
        Recommendation.objects.filter(**cohort_key(cohort)._asdict()).delete()
