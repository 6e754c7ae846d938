"""A small filled server of release 1.0, as a backup of each database.

`python -m tests.services.release` writes them again. That is done until 1.0.0 is released, and never after.
"""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.builders.documents import device_document, session_document, submission_document
from tests.services import exploring, intake
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Services, Serving, command, shell
from tests.waiting import until

FOLDER = Path(__file__).parent / "release_1_0"
SESSIONS, DEFAULT_US, BEST_US = 3, 80_000, 10_000
MEASURED, ASKED = 12, 16  # evaluations of the exploration
# Each other installation has one session: of the same model, of its alias, of a model that is rare.
RARE_BELOW = {"FRONTRUNNER_RARE_BELOW": "2"}
MODEL, ALIAS, RARE = "Pixel 8", "Pixel 8 EU", "Pixel 7"
DECIDED = f"""
from crowd.devices.aliases import decisions
from crowd.devices.models import DeviceModel
from crowd.results import moderation
from crowd.results.models import MeasurementSession
from crowd.results.opendata import exports
model, alias = (DeviceModel.objects.get(name=name) for name in ({MODEL!r}, {ALIAS!r}))
decisions.merge([alias], model, "admin")
moderation.decide("quarantine", "admin", "it was in the sun", MeasurementSession.objects.latest("pk"))
exports.create_export()
"""
WITHOUT_SHIPPED = """
from django.db import connection
from crowd.explorations.models import Evaluation, Exploration
Evaluation.objects.exclude(exploration__reference_device__name="board").delete()
Exploration.objects.exclude(reference_device__name="board").delete()
connection.cursor().execute("VACUUM")
"""


def backup(database: str) -> Path:
    """The file of `database`, sqlite or postgresql."""
    return FOLDER / f"{database}.tar.gz"


def content(database: str) -> dict[str, Any]:
    """What is known of its content: `token` with the ids `runs`, and the token `erased`, which has none."""
    return dict(json.loads(backup(database).with_suffix(".json").read_text()))


def with_tools(postgresql: PostgreSQL, url: str) -> Services:
    """The environment of a server on the database `url` of `postgresql` that can be backed up."""
    path = f"{postgresql.executable.parent}{os.pathsep}{os.environ['PATH']}"
    return LIMITS | {"PATH": path, "DATABASE_URL": url}


def write(database: str, services: Services) -> None:
    """Fill a server with `services`, and write its backup and what is known of it."""
    file = backup(database)
    file.parent.mkdir(exist_ok=True)
    file.unlink(missing_ok=True)
    documents = [
        submission_document(session_document(default_us=DEFAULT_US, best_us=BEST_US)) for _ in range(SESSIONS)
    ]
    services = services | RARE_BELOW
    with tempfile.TemporaryDirectory() as folder:
        var = Path(folder) / "var"
        intake.prepare(var, services)
        exploring.start_large(var, services, MEASURED, ASKED)
        with Serving(var, services) as server:
            token, erased = server.enrol(), server.enrol()
            for document in documents:
                server.submit_until_accepted(token, document)
            server.submit_until_accepted(erased, submission_document())
            for model in (MODEL, ALIAS, RARE):
                document = submission_document(device=device_document(model))
                server.submit_until_accepted(server.enrol(), document)
            until(lambda: server.waiting() == 0)
            shell(var, DECIDED, **services)
            server.call("DELETE", "/api/v1/me", Authorization=f"Bearer {erased}")
            shell(var, WITHOUT_SHIPPED, **services)
            done = command(var, "backup", str(file), **services)
        assert done.returncode == 0, done.stderr
    known = {"token": token, "erased": erased, "runs": intake.runs_of(documents)}
    file.with_suffix(".json").write_text(f"{json.dumps(known)}\n")


@contextmanager
def _databases() -> Iterator[dict[str, Services]]:
    with PostgreSQL() as postgresql:
        yield {"sqlite": LIMITS, "postgresql": with_tools(postgresql, postgresql.url)}


if __name__ == "__main__":
    with _databases() as databases:
        for name, environment in databases.items():
            write(name, environment)
