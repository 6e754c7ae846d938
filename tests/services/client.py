"""`python -m client_kit evaluate`, as the owner of a board runs it."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.services.program import ROOT, Program
from tests.services.serving import environment


class Client(Program):
    """Serves `device` for the server at URL, with its own data folder `home`."""

    def __init__(self, home: Path, url: str, device: str, token: str) -> None:
        self.url, self.device, self.token, self.home = url, device, token, home
        self.folder, self.log = ROOT, home / "client.txt"
        home.mkdir()

    def command(self) -> Sequence[str]:
        options = ["--server", self.url, "--device", self.device, "--token", self.token]
        return [sys.executable, "-u", "-m", "client_kit", "evaluate", *options]

    def environment(self) -> Mapping[str, str]:
        return environment(self.home, FRONTRUNNER_HOME=str(self.home))

    def ready(self) -> bool:
        return "Serving" in self.said()
