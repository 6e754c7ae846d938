"""The command that repeats an exploration, for those that were created in the administration."""

import shlex
from pathlib import Path

from django.conf import settings

from crowd.explorations.models import Exploration
from pareto import Space

SPACES = Path("pareto") / "spaces"
NUMBERS = ("seed", "budget", "batch", "points", "repeats")


def creation_command(exploration: Exploration) -> str:
    """`python manage.py exploration start ...` with all options of `exploration`.

    Empty if a command line cannot express it: a space that is not shipped, or other options of the method
    than the number of initial samples.
    """
    space = SPACES / f"{exploration.application}.json"
    path = settings.BASE_DIR / space
    if not path.exists() or Space.load(path).to_dict() != exploration.space:
        return ""
    if not set(exploration.options) <= {"initial"}:
        return ""
    words = [
        *("python", "manage.py", "exploration", "start", "--space", str(space)),
        *(word for pack in exploration.learned_on for word in ("--sequence", pack["name"])),
        *(word for pack in exploration.held_out_sequences for word in ("--held-out", pack["name"])),
        *("--objectives", ",".join(exploration.objectives)),
        *(word for name, most in exploration.limits.items() for word in ("--limit", f"{name}={most}")),
        *(() if exploration.limits else ("--no-limits",)),
        *("--method", exploration.method),
        *(word for name in NUMBERS for word in (f"--{name}", str(getattr(exploration, name)))),
        *("--device", exploration.reference_device.name),
    ]
    for option, value in (
        ("--random", exploration.options.get("initial")),
        ("--frames", exploration.frames),
        ("--warm-start", exploration.warm_start_from_id),
        ("--quantile", None if exploration.error_quantile == 1.0 else exploration.error_quantile),
    ):
        words += [option, str(value)] if value is not None else []
    words += [] if exploration.synchronous else ["--asynchronous"]
    words += [] if exploration.recheck else ["--no-recheck"]
    return shlex.join(words)
