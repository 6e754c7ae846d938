"""What erasures take along. Every process imports it: it needs none of the tables."""

from collections.abc import Iterable

from crowd.predictions.models import Recommendation
from crowd.results.models import Cohort


def forget_erased(cohorts: Iterable[Cohort], **_: object) -> None:
    """Delete what was recommended for the devices of COHORTS: it may rest on erased measurements."""
    for cohort in cohorts:
        Recommendation.objects.filter(
            device=cohort.device_id,
            front=cohort.front_id,
            backend=cohort.backend,
            processor=cohort.processor,
            processor_class=cohort.processor_class,
        ).delete()
