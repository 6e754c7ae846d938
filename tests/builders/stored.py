"""A database that the tests of a module share: filled once, emptied after them. What a test changes there is
undone at its end.
"""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from django.core.management import call_command
from django.test import Client, override_settings

from crowd.devices.services import enrol
from crowd.predictions import maps
from tests.builders.documents import write_pack
from tests.builders.participant import Participant


def join() -> Participant:
    """One more participant, from a network of its own."""
    installation, token = enrol("client_kit", "0.1.0", 1, network=secrets.token_hex(16))
    return Participant(Client(), token, str(installation.pk))


@contextmanager
def filling(blocker: Any, folder: Path, **settings: Any) -> Iterator[dict[str, Any]]:
    """What is stored meanwhile stays, under the settings of tests and these. Gives the pack of a sequence.

    `blocker` is the fixture django_db_blocker; `folder` an empty one for data.
    """
    ordinary = {
        "FRONTRUNNER_VAR": folder,
        "FRONTRUNNER_SEQUENCES": [folder / "sequences"],
        "FRONTRUNNER_RARE_BELOW": 1,
        "FRONTRUNNER_QUORUM": 1,
    }
    maps._reference_belief.cache_clear()
    with pytest.MonkeyPatch.context() as patch, blocker.unblock(), override_settings(**ordinary | settings):
        patch.setattr("crowd.results.intake.admission._released_fronts", {})
        yield write_pack(folder / "sequences")


def empty() -> None:
    """Delete all rows, and what guards them meanwhile."""
    call_command("flush", verbosity=0, interactive=False)
