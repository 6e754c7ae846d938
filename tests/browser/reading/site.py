"""A site that has something to show on every page, and an address for each of them.

Filled once, only read from: the tests that change a site make one of their own.
"""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.cache import cache
from django.core.management import call_command
from django.test import Client, override_settings
from django.urls import URLPattern, reverse
from pytest_django.live_server_helper import LiveServer

from crowd.dashboard.urls import urlpatterns
from crowd.devices.models import Installation
from crowd.devices.services import enrol
from crowd.fronts.publishing.services import publish_content
from crowd.results.opendata import exports
from crowd.results.privacy.own_page import own_page_path
from tests.builders import searches
from tests.builders.documents import (
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
    write_pack,
)
from tests.builders.participant import Participant

# Addresses end in a slash where a person reads them; figures, tables and pictures end in their format's name.
PARTS = {"exploration-live"}
SEARCHED = [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), None]
# The phones that are measured, with the names of their processors and the time of best.
PHONES = [
    ("Pixel 8", "Mali-G715", 9_000),
    ("Pixel 8", "Mali-G715", 10_500),
    ("Pixel 8", "Mali-G715", 12_000),
    ("Pixel 7", "Mali-G710", 13_500),
    ("Redmi Note 12 Pro 5G Speed Edition Plus", "Adreno (TM) 619", 15_000),
    ("P30", "NVIDIA T4", 16_500),
    ("S21", "Samsung Xclipse 920", 18_000),
]
# Models among them: what the headline counts.
COUNTED = len({model for model, _, _ in PHONES})
UNCONFIRMED = "P40"
# Static files as they are, without digests in their names.
PLAIN = {"staticfiles": {"BACKEND": "django.contrib.staticfiles.storage.StaticFilesStorage"}}


# Pages that look otherwise without what they are asked for.
OTHER_STATES = {"compare-nothing": "/compare/", "devices-emptied": "/devices/?vendor=Mali&os=Windows"}
# Charts for other sites to frame: all of one template.
EMBEDDED = "-embed"
# The API for people to read: its index, and the longest page of a call.
API_PAGES = {"api": "/api/v1/docs", "api-call": "/api/v1/docs/submit"}


def page_names() -> list[str]:
    """The names of all pages that stand for themselves, as urls.py has them."""
    names = [name for name in _patterns() if not name.endswith(EMBEDDED)]
    return [*names, *OTHER_STATES, *API_PAGES]


def _patterns() -> dict[str, URLPattern]:
    return {
        str(pattern.name): pattern
        for pattern in urlpatterns
        if isinstance(pattern, URLPattern) and _is_page(pattern)
    }


def _is_page(pattern: URLPattern) -> bool:
    route = str(pattern.pattern)
    return (route == "" or route.endswith("/")) and pattern.name not in PARTS


@dataclass(frozen=True)
class Site:
    """A server's URL, and `pages`: the name of each page with an address that shows it filled."""

    url: str
    pages: dict[str, str]


@contextmanager
def running(folder: Path) -> Iterator[Site]:
    """The filled site on a port of its own, its files below `folder`; an empty database at the end."""
    (folder / "static").mkdir()
    overrides = {
        "FRONTRUNNER_VAR": folder,
        "FRONTRUNNER_SEQUENCES": [folder / "sequences"],
        "FRONTRUNNER_RARE_BELOW": 1,
        "FRONTRUNNER_QUORUM": 1,
        # The tests together read more pages than one person.
        "FRONTRUNNER_PAGES_PER_MINUTE": 0,
        "STATIC_ROOT": folder / "static",
        "STORAGES": settings.STORAGES | PLAIN,
        "ALLOWED_HOSTS": ["localhost", "testserver"],
    }
    with override_settings(**overrides):
        try:
            pages = fill(folder)
            server = LiveServer("localhost")
            try:
                yield Site(server.url, pages)
            finally:
                server.stop()
        finally:
            call_command("flush", verbosity=0, interactive=False)


def fill(folder: Path) -> dict[str, str]:
    """Fronts, phones, a slow, a lost and an unconfirmed session, a search, an export;
    where pages are.
    """
    pack = write_pack(folder / "sequences")
    publish_content(front_document(pack, version="early"))
    publish_content(front_document(pack))
    search = searches.exploration(pack)
    searches.measure(search, searches.KNOWN)
    searches.measure(search, SEARCHED)
    sessions = [_send(model, processor, session_document(best_us=best)) for model, processor, best in PHONES]
    _send("Nexus 5", "Adreno (TM) 330", session_document(runs=_unbalanced()))
    _send("Moto G", "PowerVR Rogue GE8320", session_document(runs=_lost()))
    # The network of its enrolment is unknown, so it does not count as independent.
    _send(UNCONFIRMED, "PowerVR Rogue GE8320", session_document(best_us=8_000), network="")
    exports.create_export()
    # An earlier test may have asked which export is the newest.
    cache.clear()
    # By the first word of a page's name.
    arguments: dict[str, dict[str, Any]] = {
        "device": {"slug": "google-pixel-8"},
        "front": {"slug": "kfusion-test"},
        "export": {"name": "latest"},
        "groups": {"by": "vendor"},
        "exploration": {"key": search.pk, "objective": "runtime"},
        "session": {"uuid": sessions[0]["id"]},
        "run": {"uuid": sessions[0]["runs"][1]["id"]},
        "mine": {"signed": own_page_path(Installation.objects.earliest("created_at")).split("/")[2]},
    }
    queries = {
        "compare": "?devices=google-pixel-8,google-pixel-7",
        "front": "?against=kfusion-early",
        "search": "?q=pixel",
    }

    def address(name: str, pattern: URLPattern) -> str:
        word = name.partition("-")[0]
        needed = {argument: arguments[word][argument] for argument in pattern.pattern.converters}
        return reverse(f"dashboard:{name}", kwargs=needed) + queries.get(word, "")

    addresses = {name: address(name, pattern) for name, pattern in _patterns().items()}
    return addresses | OTHER_STATES | API_PAGES


def _send(
    model: str,
    processor: str,
    session: dict[str, Any],
    network: str | None = None,
) -> dict[str, Any]:
    """`session` through the API, from an installation and a network of its own; as it was sent."""
    own_network = secrets.token_hex(16) if network is None else network
    _, token = enrol("client_kit", "0.1.0", 1, network=own_network)
    device = device_document(model, opencl_device=processor)
    # The server sees no address: an unknown network stays unknown.
    participant = Participant(Client(REMOTE_ADDR="unknown"), token, "")
    response = participant.submit(submission_document(session, device=device))
    assert response.status_code == 202, response.content
    return session


def _unbalanced() -> list[dict[str, Any]]:
    """Default first and best last: suspect."""
    return [
        run_document("default", 0, 0, 80_000),
        run_document("default", 1, 1, 120_000),
        run_document("best", 0, 2, 10_000),
        run_document("best", 1, 3, 15_000),
    ]


def _lost() -> list[dict[str, Any]]:
    """Runs of which the best ones lost the camera: no figure."""
    return [
        run_document("default", 0, 0, 80_000),
        run_document("best", 0, 1, 1_000, ate_max=0.4),
        run_document("best", 1, 2, 1_000, ate_max=0.4),
        run_document("default", 1, 3, 80_000),
    ]
