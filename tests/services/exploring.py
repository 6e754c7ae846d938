"""Explorations over the table, made in this process or beside a server, on the data that it serves."""

import json
from pathlib import Path
from typing import Any

from crowd.explorations import services, tasks
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from tests.crowd.documents import write_pack
from tests.services.serving import Services, command
from tests.services.table import SPACE

DEVICE = "table"
SETTINGS = {"DJANGO_SETTINGS_MODULE": "tests.services.settings"}


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


def start(var: Path, environment: Services, **wishes: Any) -> int:
    """The key of a new exploration on the data folder VAR, of which the first messages are sent."""
    return int(_beside(var, environment, f"create_and_dispatch({str(var)!r}, {json.dumps(wishes)!r})"))


def rows(var: Path, environment: Services, exploration: int) -> list[dict[str, Any]]:
    """The exploration's evaluations by number."""
    found: list[dict[str, Any]] = json.loads(_beside(var, environment, f"print_rows({exploration})"))
    return found


def _beside(var: Path, environment: Services, call: str) -> str:
    """What CALL of this module prints in a process with a server's ENVIRONMENT."""
    code = f"from tests.services import exploring; exploring.{call}"
    done = command(var, "shell", "--no-imports", "-c", code, **environment | SETTINGS)
    assert done.returncode == 0, done.stderr
    return done.stdout
