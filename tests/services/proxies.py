"""nginx and Caddy with the files of deploy/, on ports and a certificate of their own."""

import os
import re
import shutil
import ssl
import subprocess
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.services.program import ROOT, Program, free_port, listens

HOST = "frontrunner.example"
DEPLOY = ROOT / "deploy"
# As Debian ships it; deploy/nginx.conf recommends more.
NGINX = """
{user}
daemon off;
worker_processes 1;
pid {folder}/nginx.pid;
error_log stderr;
events {{ worker_connections 768; }}
http {{
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {folder}/frontrunner.conf;
}}
"""


class Missing(Exception):  # noqa: N818 - what it says
    """A program that is not installed; the message names Debian's package."""


class Proxy(Program):
    """TLS in front of the server at the port `server`, in a with statement."""

    def __init__(self, folder: Path, server: int) -> None:
        self.folder, self.log = folder, folder / "proxy.txt"
        folder.mkdir()
        self.port, self.server = free_port(), server
        self.certificate, self.key = make_certificate(folder)
        self.configure()

    @abstractmethod
    def configure(self) -> None:
        """Write the configuration into the folder."""

    def ready(self) -> bool:
        return listens(self.port)

    def context(self) -> ssl.SSLContext:
        """What a client needs that trusts this proxy's certificate."""
        return ssl.create_default_context(cafile=str(self.certificate))


class Nginx(Proxy):
    """Debian's package nginx."""

    def configure(self) -> None:
        self.program = installed("nginx")
        text = (DEPLOY / "nginx.conf").read_text()
        text = text.replace("127.0.0.1:8000", f"127.0.0.1:{self.server}")
        text = text.replace("listen 443 ssl", f"listen 127.0.0.1:{self.port} ssl")
        text = text.replace("listen 80;", f"listen 127.0.0.1:{free_port()};")
        text = re.sub(r"listen \[::\].*", "", text)
        text = text.replace("/var/log/nginx/error.log", str(self.folder / "error.log"))
        text = text.replace("/etc/ssl/frontrunner/fullchain.pem", str(self.certificate))
        text = text.replace("/etc/ssl/frontrunner/privkey.pem", str(self.key))
        (self.folder / "frontrunner.conf").write_text(text)
        user = "user root;" if os.geteuid() == 0 else ""
        (self.folder / "nginx.conf").write_text(NGINX.format(folder=self.folder, user=user))

    def command(self) -> Sequence[str]:
        return [self.program, "-p", str(self.folder), "-c", str(self.folder / "nginx.conf"), "-e", "stderr"]


class Caddy(Proxy):
    """Debian's package caddy."""

    def configure(self) -> None:
        self.program = installed("caddy")
        text = (DEPLOY / "Caddyfile").read_text()
        text = text.replace("127.0.0.1:8000", f"127.0.0.1:{self.server}")
        text = text.replace("{\n", "{\n\tadmin off\n\tauto_https disable_redirects\n", 1)
        site = f"https://{HOST}:{self.port} {{\n\tbind 127.0.0.1\n\ttls {self.certificate} {self.key}\n"
        text = text.replace(f"\n{HOST} {{\n", f"\n{site}")
        (self.folder / "Caddyfile").write_text(text)

    def command(self) -> Sequence[str]:
        return [self.program, "run", "--config", str(self.folder / "Caddyfile"), "--adapter", "caddyfile"]

    def environment(self) -> Mapping[str, str]:
        own = {name: str(self.folder) for name in ("HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME")}
        return os.environ | own


@contextmanager
def running(kind: type[Proxy], folder: Path, server: int) -> Iterator[Proxy]:
    """A proxy in front of the server at that port; the test is skipped where it is not installed."""
    try:
        proxy = kind(folder, server)
    except Missing as missing:
        pytest.skip(str(missing))
    with proxy:
        yield proxy


def installed(program: str) -> str:
    """Where `program` is. Raises Missing."""
    places = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin"))
    found = shutil.which(program, path=places)
    if found is None:
        raise Missing(f"no {program} here: it comes with Debian's package {program}")
    return found


def make_certificate(folder: Path) -> tuple[Path, Path]:
    """A self-signed certificate for HOST and its key, in `folder`. Raises Missing."""
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    options = ["-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={HOST}"]
    named = ["-addext", f"subjectAltName=DNS:{HOST}", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run([installed("openssl"), "req", "-x509", *options, *named], capture_output=True, check=True)
    return certificate, key
