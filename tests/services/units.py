"""`systemctl` and `journalctl` where no systemd runs: they carry out what the installed units say.

User, WorkingDirectory, UMask, environment, folders, commands and restarts are the unit's own. Sandboxing and
the times of timers are left out.
"""

import os
import pwd
import re
import shlex
import signal
import subprocess
import sys
import time
from configparser import RawConfigParser
from pathlib import Path

UNITS, STATE = Path("/etc/systemd/system"), Path("/run/units")


class Service:
    """An installed unit of that name."""

    def __init__(self, name: str) -> None:
        self.name = name if "." in name else f"{name}.service"
        self.parser = RawConfigParser(strict=False, delimiters=("=",), interpolation=None)
        self.parser.optionxform = str  # type: ignore[assignment,method-assign]
        with (UNITS / self.name).open() as file:
            self.parser.read_file(file)
        self.log, self.pid = STATE / f"{self.name}.log", STATE / f"{self.name}.pid"

    def start(self) -> None:
        """Run the commands; a service that is not `oneshot` goes on running."""
        if self.name.endswith(".timer"):
            Service(self.name.replace(".timer", ".service"))  # is installed, too
            return
        unit = self.parser["Service"]
        user = pwd.getpwnam(unit["User"])
        for key, parent in (("StateDirectory", "/var/lib"), ("CacheDirectory", "/var/cache")):
            if key in unit:
                folder = Path(parent) / unit[key]
                folder.mkdir(parents=True, exist_ok=True)
                folder.chmod(int(unit.get(f"{key}Mode", "0755"), 8))
                os.chown(folder, user.pw_uid, user.pw_gid)
        environment = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": user.pw_dir, "LANG": "C.UTF-8"}
        lines = Path(unit["EnvironmentFile"]).read_text().splitlines()
        for setting in [*shlex.split(unit.get("Environment", "")), *lines]:
            if setting and not setting.startswith("#"):
                name, _, value = setting.partition("=")
                environment[name] = value
        for key in ("ExecStartPre", "ExecStart", "ExecStartPost"):
            if key not in unit:
                continue
            command = _words(unit[key], environment)
            if key == "ExecStart" and unit.get("Type") != "oneshot":
                self._keep(command, environment)
            elif self._run(command, environment).wait():
                sys.exit(f"{self.name}: {unit[key]!r} failed:\n{self.log.read_text()}")

    def _run(self, command: list[str], environment: dict[str, str]) -> subprocess.Popen[bytes]:
        unit = self.parser["Service"]
        user = pwd.getpwnam(unit["User"])
        with self.log.open("ab") as log:
            return subprocess.Popen(
                command,
                env=environment,
                cwd=unit["WorkingDirectory"],
                user=user.pw_uid,
                group=user.pw_gid,
                extra_groups=[],
                umask=int(unit.get("UMask", "0022"), 8),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def _keep(self, command: list[str], environment: dict[str, str]) -> None:
        """Run the service in the background, again whenever it ends, as Restart=always says."""
        assert self.parser["Service"]["Restart"] == "always"
        if keeper := os.fork():
            self.pid.write_text(str(keeper))
            return
        while True:
            process = self._run(command, environment)

            def stop(*_: object, process: subprocess.Popen[bytes] = process) -> None:
                os.kill(process.pid, signal.SIGTERM)
                os.waitpid(process.pid, 0)  # process.wait() waits already, and holds its lock
                os._exit(0)

            signal.signal(signal.SIGTERM, stop)
            process.wait()
            time.sleep(int(self.parser["Service"]["RestartSec"]))

    def stop(self) -> None:
        """End the service, and wait for its end."""
        pid = int(self.pid.read_text())
        os.kill(pid, signal.SIGTERM)
        status = Path(f"/proc/{pid}/stat")
        while status.exists() and status.read_text().rpartition(") ")[2][0] != "Z":
            time.sleep(0.1)


def _words(command: str, environment: dict[str, str]) -> list[str]:
    """The words of an Exec line: %% and $$ are signs, ${NAME} is a variable."""

    def value(match: re.Match[str]) -> str:
        return environment.get(match[1], "") if match[1] else "$"

    words = shlex.split(command.replace("%%", "%"))
    return [re.sub(r"\$\$|\$\{(\w+)\}", value, word) for word in words]


def main(program: str, *words: str) -> None:
    """Carry out one command line."""
    STATE.mkdir(exist_ok=True)
    if program == "journalctl":
        sys.stdout.write(Service(words[-1]).log.read_text())
        return
    verb, *names = words
    for service in (Service(name) for name in names if name != "--now"):
        if verb in ("stop", "restart"):
            service.stop()
        if verb in ("enable", "start", "restart"):
            service.start()


if __name__ == "__main__":
    main(Path(sys.argv[1]).name, *sys.argv[2:])
