"""What the migrations of the next release do."""

import os
import signal
from typing import Any

from django.db.migrations import RunPython


def write_again(application: str, model: str) -> RunPython:
    """Delete all rows and insert them again: on PostgreSQL, their foreign keys wait to be checked."""

    def forwards(apps: Any, _editor: Any) -> None:
        rows = apps.get_model(application, model).objects
        stored = list(rows.all())
        assert stored, f"no row of {model} in the release's backup"
        rows.all().delete()
        rows.bulk_create(stored)

    return RunPython(forwards)


def killed_at(application: str) -> RunPython:
    """kill -9 of this process if KILL_AT names the application."""

    def forwards(_apps: Any, _editor: Any) -> None:
        if os.environ.get("KILL_AT") == application:
            os.kill(os.getpid(), signal.SIGKILL)

    return RunPython(forwards)
