"""Which of the configurations that were asked for a session measures, by the backend that was chosen."""

import io

import pytest

from client_kit.console import Console
from client_kit.delivery.manifest import Manifest
from client_kit.errors import CannotMeasureError
from client_kit.participating import participation
from tests.builders import manifests

ONLY_OPENCL = ("best", "fine", "finest")


@pytest.fixture
def asked() -> Manifest:
    """A front of which WebGPU holds the default and coarse alone; the protocol's order has best, too."""
    document = manifests.manifest()
    document["configurations"] += [manifests.configuration(name, {}) for name in ("finest", "coarse")]
    for configuration in document["configurations"]:
        if configuration["name"] in ONLY_OPENCL:
            configuration["backends"] = ["opencl"]
    return Manifest.parse(document)


@pytest.mark.parametrize(
    ("wanted", "backend", "measured", "note"),
    [
        ((), "webgpu", ("default", "best"), ""),
        (("fine", "coarse"), "opencl", ("default", "fine", "coarse"), ""),
        (
            ("fine", "best", "coarse"),
            "webgpu",
            ("default", "best", "coarse"),
            "fine does not fit WebGPU here and is",
        ),
        (("all",), "webgpu", ("default", "best", "coarse"), "fine and finest do not fit WebGPU here and are"),
    ],
)
def test_what_the_backend_cannot_hold_is_left_out_but_for_the_protocols_own(
    wanted: tuple[str, ...], backend: str, measured: tuple[str, ...], note: str, asked: Manifest
) -> None:
    said = io.StringIO()

    fitting = participation._select_runnable(asked.names(wanted), asked, backend, Console(said))
    [plan] = asked.plans(fitting)

    assert tuple(dict.fromkeys(plan)) == measured
    assert said.getvalue() == (f"Note: {note} left out\n" if note else "")


def test_where_nothing_fits_nothing_is_measured(asked: Manifest) -> None:
    with pytest.raises(
        CannotMeasureError, match=r"fine does not fit WebGPU here .*: nothing is left to measure"
    ):
        participation._select_runnable(("fine",), asked, "webgpu", Console(io.StringIO()))
