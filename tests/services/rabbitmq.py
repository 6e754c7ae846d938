"""A real RabbitMQ: Debian's package, as a node of its own beside whatever the machine runs."""

import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.services.program import Program, free_port, listens

# The package's own commands insist on the user rabbitmq and on the machine's one node; they call these.
HOSTS = [f"test{number}" for number in range(4)]  # a command of rabbitmqctl for each would take seconds
DEFINITIONS = {
    "users": [{"name": "guest", "password": "guest", "tags": ["administrator"]}],
    "vhosts": [{"name": name} for name in HOSTS],
    "permissions": [
        {"user": "guest", "vhost": name, "configure": ".*", "write": ".*", "read": ".*"} for name in HOSTS
    ],
}
SERVER, CONTROL = (Path("/usr/lib/rabbitmq/bin") / name for name in ("rabbitmq-server", "rabbitmqctl"))


class RabbitMQ(Program):
    """Keeps durable queues and persistent messages on disk. FileNotFoundError without the package."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "rabbitmq.txt"
        if not SERVER.exists():
            raise FileNotFoundError(SERVER)
        self.port, self.distribution_port, self.names_port = free_port(), free_port(), free_port()
        self._hosts = iter(HOSTS)
        (folder / "definitions.json").write_text(json.dumps(DEFINITIONS))
        (folder / "rabbitmq.conf").write_text(f"load_definitions = {folder / 'definitions.json'}\n")
        self.empty()

    def empty(self) -> None:
        """Give the next virtual host, which no test has used, to those that use the `url`."""
        self.url = f"amqp://guest:guest@127.0.0.1:{self.port}/{next(self._hosts)}"

    def command(self) -> Sequence[str]:
        return [str(SERVER), "-noinput"]

    def environment(self) -> Mapping[str, str]:
        return {
            "PATH": os.environ["PATH"],
            "HOME": str(self.folder),  # the cookie by which nodes know each other
            "ERL_EPMD_ADDRESS": "127.0.0.1",
            "ERL_EPMD_PORT": str(self.names_port),
            "RABBITMQ_ALLOW_INPUT": "1",  # without a shell between this process and the server
            "RABBITMQ_CONFIG_FILE": str(self.folder / "rabbitmq"),
            "RABBITMQ_CONF_ENV_FILE": str(self.folder / "none"),
            "RABBITMQ_DIST_PORT": str(self.distribution_port),
            "RABBITMQ_ENABLED_PLUGINS_FILE": str(self.folder / "enabled_plugins"),
            "RABBITMQ_LOGS": "-",
            "RABBITMQ_LOG_BASE": str(self.folder / "log"),
            "RABBITMQ_MNESIA_BASE": str(self.folder / "mnesia"),
            "RABBITMQ_NODE_IP_ADDRESS": "127.0.0.1",
            "RABBITMQ_NODE_PORT": str(self.port),
            "RABBITMQ_NODENAME": f"frontrunner{self.port}@localhost",
        }

    def control(self, *words: str) -> None:
        """Carry out a command of rabbitmqctl."""
        subprocess.run([CONTROL, "--quiet", *words], env=self.environment(), check=True)

    def ready(self) -> bool:
        return listens(self.port)

    def __enter__(self) -> "RabbitMQ":
        # Erlang's name server. The node would start one that outlives it.
        self.names = subprocess.Popen(["epmd"], env=self.environment(), stderr=subprocess.DEVNULL)
        return super().__enter__()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self.names.kill()
        self.names.wait()
