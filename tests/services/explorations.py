"""Explorations over the table, where Django is set up: in a test, or in a server's shell."""

import json
import random
from pathlib import Path
from typing import Any

from django.db import connection
from django.utils import timezone

from crowd.explorations import services, tasks
from crowd.explorations.measuring import tokens
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.searching import batches, search
from pareto import Space
from tests.builders.documents import write_pack
from tests.services.exploring import BOARD, DEVICE
from tests.services.table import DEVICE as TABLE_DEVICE
from tests.services.table import FAILING, NOTHING, SPACE
from tests.shipped import LIVING_ROOM

MEASURED = """
    UPDATE explorations_evaluation SET state = %s, objectives = %s, error = %s, attempt = 1,
        started_at = %s, finished_at = %s, stages = %s, device = %s
    WHERE id = %s
"""


def create(var: Path, machines: int = 1, **wishes: Any) -> Exploration:
    """A new exploration on the device `table` of so many `machines`, with a sequence made below `var`."""
    pack = write_pack(var / "sequences", "table-sequence")
    device = ReferenceDevice.objects.create(name=DEVICE, queue=DEVICE, machines=machines)
    return services.create(
        Exploration(
            application="table",
            space=SPACE,
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["ate_max", "runtime"],
            limits={"ate_max": 0.05},
            **wishes,
        )
    )


def create_and_dispatch(var: str, wishes: str) -> None:
    """As above, from a server's shell; prints the exploration's key."""
    exploration = create(Path(var), **json.loads(wishes))
    tasks.dispatch(exploration)
    print(exploration.pk)


def create_large(var: str, measured: int, asked: int) -> None:
    """An exploration that asked for so many configurations, with made-up values of those `measured`.

    Runtime and error trade off through the space, with noise; one in FAILING failed. Prints its key.
    """
    pack = write_pack(Path(var) / "sequences", "board-sequence")
    space = Space.load(Path("pareto/spaces/kfusion.json"))
    device = ReferenceDevice.objects.create(name=BOARD, queue=BOARD)
    exploration = services.create(
        Exploration(
            space=space.to_dict(),
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["ate_max", "runtime"],
            limits={"ate_max": 0.05},
            method="random",
            budget=asked,
        )
    )
    proposals = search.new_explorer(exploration).propose(asked)
    batches.add_evaluations(
        exploration, [(proposal.configuration, proposal.phase, "") for proposal in proposals]
    )
    chance = random.Random(0)
    now = timezone.now()
    with connection.cursor() as cursor:
        for row in exploration.evaluations.all()[:measured]:
            fine = row.configuration["volume_resolution"] / row.configuration["compute_size_ratio"]
            runtime = 1e-4 * fine * chance.lognormvariate(0, 0.3)
            error = 5 / (20 + fine) * chance.lognormvariate(0, 0.5)
            values = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2, "ate_rmse": error / 2}
            failed = chance.randrange(FAILING) == 0
            cursor.execute(
                MEASURED,
                [
                    *(("failed", None, NOTHING) if failed else ("done", json.dumps(values), "")),
                    *(now, now, json.dumps({"computation": runtime}), json.dumps(TABLE_DEVICE), row.pk),
                ],
            )
    print(exploration.pk)


def create_measured() -> None:
    """An exploration by real measurements on the device `board`; prints its token."""
    space = Space.load(Path("pareto/spaces/kfusion.json"))
    pack = json.loads((LIVING_ROOM / "pack.json").read_text())
    device = ReferenceDevice.objects.create(name=BOARD, queue=BOARD)
    exploration = services.create(
        Exploration(
            space=space.to_dict(),
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["ate_max", "runtime"],
            method="random",
            budget=1,
            frames=11,
        )
    )
    tasks.dispatch(exploration)
    print(tokens.issue_token(device))
