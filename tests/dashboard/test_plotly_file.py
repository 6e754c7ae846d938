"""The plot library reaches visitors from the installed wheel, compressed, under an address of its own."""

import gzip
from pathlib import Path
from typing import Any

from django.contrib.staticfiles import finders
from django.core.management import call_command


def test_the_library_is_found_in_the_installed_package() -> None:
    path = finders.find("plotly/plotly.min.js")

    assert isinstance(path, str)
    assert b"plotly.js v" in Path(path).read_bytes()[:100]


def test_nothing_else_of_that_package_is_served() -> None:
    assert finders.find("plotly/widgetbundle.js") is None


def test_collecting_static_files_compresses_the_library(settings: Any) -> None:
    settings.STORAGES = settings.STORAGES | {
        "staticfiles": {"BACKEND": "whitenoise.storage.CompressedManifestStaticFilesStorage"}
    }

    call_command("collectstatic", interactive=False, verbosity=0)

    (packed,) = (Path(settings.STATIC_ROOT) / "plotly").glob("plotly.min.*.js.gz")
    assert packed.stat().st_size < 1_600_000
    assert gzip.decompress(packed.read_bytes()).startswith(b"/**\n* plotly.js v")
