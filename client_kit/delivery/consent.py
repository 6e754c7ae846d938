"""The consent of a participant before anything is measured or sent."""

import json
import re
import time
from collections.abc import Mapping
from typing import Any

from client_kit.home import Home

_DOCUMENT = "consent.json"

TEXT = """\
Frontrunner measures how fast dense SLAM runs on devices such as this one.

What happens
  - This device downloads a public test sequence ({megabytes:.0f} MB, once) and works on it alone.
    No camera, no microphone and no file of yours is used.
  - It computes for some minutes and gets warm; on battery that costs charge.
  - The times, and what the device says of its make, are sent to {server}.
  - It may then offer to measure a few more configurations. You are asked each time, and the same kinds of
    data are sent.

What is sent, with the values of this device
{sample}

What is never sent: your name, the device's name, serial numbers, network addresses, places.
The server knows this installation by a random number. It stores a keyed hash of your network with it.
What you sent can be read at any time with `frontrunner measure export` and is erased, here and there, by
`frontrunner measure erase`.
Consent {version}.
"""


def text(server: str, version: int, sequence_bytes: int, sample: Mapping[str, Any]) -> str:
    """The consent text, with `sample` as an example of this device's payload."""
    document = json.dumps(sample, indent=2, ensure_ascii=False)
    # Lists of numbers on one line each, for readability.
    lines = re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: f"[{' '.join(m[1].split())}]", document).splitlines()
    return TEXT.format(
        megabytes=sequence_bytes / 1e6,
        server=server,
        sample="\n".join(f"    {line}" for line in lines),
        version=version,
    )


def is_agreed(home: Home, server: str, version: int) -> bool:
    """Whether this version was agreed to for this server."""
    agreed = home.read(_DOCUMENT).get(server)
    return agreed is not None and agreed["version"] == version


def remember(home: Home, server: str, version: int) -> None:
    """Record that the participant agrees."""
    agreed = {"version": version, "at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())}
    home.write(_DOCUMENT, {**home.read(_DOCUMENT), server: agreed})


def withdraw(home: Home) -> None:
    """Forget every agreement: the next measurement asks again."""
    home.remove(_DOCUMENT)
