"""What an application needs beyond the base installation, which runs KinectFusion alone."""

import sys
from importlib.util import find_spec
from pathlib import Path

from client_kit.device.description import is_android
from client_kit.errors import CannotMeasureError, OutdatedError

# By application the packages of its extra, with the module by which each is found.
NEEDED = {
    "elasticfusion": {"opencv-python-headless": "cv2", "scipy": "scipy"},
    "kfusion": {},
}
ON_ANDROID = {"opencv-python-headless": "opencv-python", "scipy": "python-scipy"}


def require(application: str, root: Path = Path("/")) -> None:
    """Raises OutdatedError for an application that this version does not have, CannotMeasureError, naming the
    command to be given, where a package is missing for it."""
    if application not in NEEDED:
        raise OutdatedError(
            f"this client measures {', '.join(NEEDED)} and knows no {application}: update it, or name one of "
            "these (--application)"
        )
    missing = [package for package, module in NEEDED[application].items() if find_spec(module) is None]
    if missing:
        if is_android(root):
            command = f"pkg install {' '.join(ON_ANDROID[package] for package in missing)}"
        else:
            command = f"{Path(sys.executable).name} -m pip install {' '.join(missing)}"
        raise CannotMeasureError(
            f"{application} needs {' and '.join(missing)}, not installed here: {command}"
        )
