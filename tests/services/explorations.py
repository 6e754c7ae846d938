"""Explorations over the table, where Django is set up: in a test, or in a server's shell."""

import json
from pathlib import Path
from typing import Any

from crowd.explorations import services, tasks, tokens
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from pareto import Space
from tests.crowd.documents import write_pack
from tests.services.exploring import BOARD, DEVICE
from tests.services.table import SPACE
from tests.slam.shipped import LIVING_ROOM


def create(var: Path, machines: int = 1, **wishes: Any) -> Exploration:
    """A new exploration on the device `table` of so many MACHINES, with a sequence made below VAR."""
    pack = write_pack(var / "sequences")
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


def print_rows(exploration: int) -> None:
    """The exploration's evaluations by number, as JSON."""
    names = "pk", "number", "phase", "configuration", "state", "attempt", "objectives", "error"
    found = Evaluation.objects.filter(exploration=exploration).order_by("number").values(*names)
    print(json.dumps(list(found)))


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
