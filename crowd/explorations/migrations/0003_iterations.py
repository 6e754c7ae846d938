"""What the saved state of a search told is told by its rows from now on."""

from django.db import migrations

from pareto import Space
from pareto.errors import ParetoError

SEARCHED = ("random", "active")


def fill(apps, schema_editor):
    """Number the times that each exploration asked, and give every configuration its place in the space."""
    Exploration = apps.get_model("explorations", "Exploration")
    Evaluation = apps.get_model("explorations", "Evaluation")
    Exploration.objects.filter(state="stopped").update(state="cancelled")
    for exploration in Exploration.objects.all():
        try:
            space = Space.from_dict(exploration.space)
        except ParetoError:
            space = None
        rows = list(Evaluation.objects.filter(exploration=exploration).order_by("number"))
        searched = 0
        for row in rows:
            row.iteration = _iteration(row.phase, searched, exploration)
            searched += row.phase in SEARCHED
            row.index = _index(space, row.configuration)
        Evaluation.objects.bulk_update(rows, ["iteration", "index"], batch_size=500)


def _iteration(phase, searched, exploration):
    if phase == "given":
        return 0
    if phase in SEARCHED:
        return 1 + searched // exploration.batch
    return 1 + -(-exploration.budget // exploration.batch)


def _index(space, configuration):
    if space is None:
        return None
    try:
        return int(space.encode(configuration))
    except ParetoError:
        return None


def unfill(apps, schema_editor):
    apps.get_model("explorations", "Exploration").objects.filter(state__in=("cancelled", "paused")).update(
        state="stopped"
    )


class Migration(migrations.Migration):

    dependencies = [
        ("explorations", "0002_derived_from_rows"),
    ]

    operations = [migrations.RunPython(fill, unfill)]
