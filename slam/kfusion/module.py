"""Builds kernels.wasm: every kernel of KinectFusion, laid out by rows.

    python -m slam.kfusion.module [TARGET]

TARGET is the file to write, by default the one that ships.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from slam.devices.tuning import SCENE
from slam.devices.wasm import LAYOUT
from slam.kfusion.definition import TRIED
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import plan
from slam.plans.wasm import MODULE
from slam.plans.wasm_module.build import build


def main() -> None:
    """Build the module. Ends with the compiler's message where it refuses a kernel."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDERS[0] / MODULE
    try:
        build(plan(replace(TRIED, skip_limit=1, raycast_after_fusion=1), SCENE, LAYOUT), FOLDERS, target)
    except subprocess.CalledProcessError as error:
        sys.exit(error.stderr)


if __name__ == "__main__":
    main()
