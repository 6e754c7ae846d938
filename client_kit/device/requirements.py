"""Packages of an application beyond the base installation, which runs only KinectFusion."""

import sys
from importlib.util import find_spec
from pathlib import Path

from client_kit.device.description import is_android
from client_kit.errors import CannotMeasureError, OutdatedError
from slam.definitions import SYSTEMS

ON_ANDROID = {"opencv-python-headless": "opencv-python", "scipy": "python-scipy"}


def require(application: str, root: Path = Path("/")) -> None:
    """Raises OutdatedError for an unknown application, CannotMeasureError, with the command to install it,
    for a missing package."""
    if application not in SYSTEMS:
        raise OutdatedError(
            f"this client measures {', '.join(SYSTEMS)}, not {application}: update it, or name one of "
            "these (--application)"
        )
    packages = SYSTEMS[application].packages.items()
    missing = [package for package, module in packages if find_spec(module) is None]
    if missing:
        if is_android(root):
            command = f"pkg install {' '.join(ON_ANDROID[package] for package in missing)}"
        else:
            command = f"{Path(sys.executable).name} -m pip install {' '.join(missing)}"
        raise CannotMeasureError(
            f"{application} needs {' and '.join(missing)}, not installed here: {command}"
        )
