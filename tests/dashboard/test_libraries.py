"""Scripts of others reach visitors from installed wheels, compressed, under addresses of their own."""

import gzip
import re
from pathlib import Path
from typing import Any

import pytest
from django.contrib.staticfiles import finders
from django.core.management import call_command


@pytest.mark.parametrize(
    ("address", "words"), [("plotly/plotly.min.js", b"plotly.js v"), ("htmx/htmx-2.min.js", b"htmx")]
)
def test_a_library_is_found_in_its_installed_package(address: str, words: bytes) -> None:
    path = finders.find(address)

    assert isinstance(path, str)
    assert words in Path(path).read_bytes()[:100]


@pytest.mark.parametrize("address", ["plotly/widgetbundle.js", "htmx/htmx-4.min.js", "htmx-2.min.js"])
def test_nothing_else_of_those_packages_is_served(address: str) -> None:
    assert finders.find(address) is None


@pytest.mark.slow
def test_collecting_static_files_compresses_the_libraries(settings: Any) -> None:
    settings.STORAGES = settings.STORAGES | {
        "staticfiles": {"BACKEND": "whitenoise.storage.CompressedManifestStaticFilesStorage"}
    }

    call_command("collectstatic", interactive=False, verbosity=0)

    static = Path(settings.STATIC_ROOT)
    (plotly,) = (static / "plotly").glob("plotly.min.*.js.gz")
    assert plotly.stat().st_size < 1_600_000
    assert gzip.decompress(plotly.read_bytes()).startswith(b"/**\n* plotly.js v")
    (htmx,) = (static / "htmx").glob("htmx-2.min.*.js.gz")
    assert htmx.stat().st_size < 20_000


def test_the_small_plotly_is_of_the_version_that_the_figures_are_written_for() -> None:
    versions = set()
    for address in ("plotly/plotly.min.js", "plotly/plotly-basic.min.js"):
        path = finders.find(address)
        assert isinstance(path, str)
        head = Path(path).read_bytes()[:100]
        versions.update(re.findall(rb"plotly.js (?:\(basic - minified\) )?v([0-9.]+)", head))

    assert len(versions) == 1
