"""Times per frame of a device model, averaged like its speedups, to compare two devices."""

from collections import defaultdict

from django.db.models import Avg, Count
from django.db.models.functions import Ln

from crowd.devices.disclosure import find
from crowd.records.speedup import Speedup
from crowd.records.uncertainty import Estimate
from crowd.results.figures import statistics
from crowd.results.models import Run, State
from wire.front import BEST, DEFAULT


def log_times(figure: Speedup) -> dict[str, Estimate]:
    """Log microseconds per frame by configuration (default and best), from the sessions of `figure`.

    A configuration without a valid run is left out. Logarithms are averaged over the runs of each
    installation, then over the installations of each network. Two queries.
    """
    model = find(figure.device.slug)
    rows = (
        Run.objects.filter(
            session__device=model,
            session__front__slug=figure.front,
            session__backend=figure.backend,
            session__processor=figure.processor,
            session__processor_class=figure.processor_class,
            session__summaries__configuration__name=BEST,
            session__summaries__state=State.SUSPECT if figure.suspect else State.VALID,
            session__summaries__counted=True,
            configuration__name__in=(DEFAULT, BEST),
            state=State.VALID,
            mean_us__gt=0,
        )
        .order_by("configuration_id", "session__installation_id")
        .values_list("configuration__name", "session__installation_id", "session__installation__network")
        .annotate(mean=Avg(Ln("mean_us")), runs=Count("pk"))
    )
    values: dict[str, list[statistics.InstallationValue]] = defaultdict(list)
    for name, _, network, mean, runs in rows:
        values[name].append(statistics.InstallationValue(mean, 0.0, runs, network or None))
    return {name: statistics.model_estimate(each) for name, each in values.items()}
