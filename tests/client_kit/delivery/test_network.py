"""Proxies and certificates, as the usual environment variables name them."""

import shutil
import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from client_kit.delivery import manifest
from client_kit.delivery.server import NotFrontrunnerError, Server, UnreachableError
from client_kit.home import Home
from tests.builders import manifests
from tests.client_kit.scripted import Reply, ScriptedServer, Serve

PROXIES = ("http_proxy", "https_proxy", "all_proxy", "no_proxy")


@pytest.fixture(autouse=True)
def no_proxies(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PROXIES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


def test_a_proxy_is_used_where_the_environment_names_one(
    serve: Serve, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    proxy = serve(lambda _: Reply(200, manifests.manifest()))
    monkeypatch.setenv("HTTP_PROXY", proxy.url)

    asked, fresh = manifest.fetch(Server("http://frontrunner.example"), home)

    assert (asked.front_version, fresh) == ("1", True)
    assert proxy.paths() == ["GET http://frontrunner.example/api/v1/manifest"]


def test_a_proxy_that_cannot_be_reached_is_named_without_its_user(
    monkeypatch: pytest.MonkeyPatch, closed_port: int
) -> None:
    monkeypatch.setenv("HTTP_PROXY", f"http://anna:secret@127.0.0.1:{closed_port}/")

    with pytest.raises(UnreachableError) as raised:
        Server("http://frontrunner.example").manifest(None)

    through = f"cannot be reached through the proxy 127.0.0.1:{closed_port} (HTTP_PROXY): Connection refused"
    assert through in str(raised.value)
    assert "secret" not in str(raised.value)


@pytest.mark.parametrize(
    ("status", "kind", "words"),
    [
        (407, UnreachableError, "which asks for a user: write its address as http://NAME:PASSWORD@HOST"),
        (403, NotFrontrunnerError, r"answers 403 Forbidden through the proxy 127\.0\.0\.1:"),
    ],
)
def test_a_proxy_that_refuses_is_named(
    status: int, kind: type[Exception], words: str, serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", serve(lambda _: Reply(status, raw=b"<html>Squid")).url)

    with pytest.raises(kind, match=words):
        Server("http://frontrunner.example").manifest(None)


def test_a_proxy_is_left_out_for_hosts_that_need_none(
    serve: Serve, home: Home, monkeypatch: pytest.MonkeyPatch, closed_port: int
) -> None:
    server = serve(lambda _: Reply(200, manifests.manifest()))
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{closed_port}")
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")

    assert manifest.fetch(Server(server.url), home)[1]


def make_authority(folder: Path) -> tuple[Path, Path]:
    """A self-signed certificate for localhost and its key."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no program openssl here to make a certificate with")
    certificate, key = folder / "root.pem", folder / "key.pem"
    words = (
        "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost"
    )
    files = ("-keyout", str(key), "-out", str(certificate))
    subprocess.run([openssl, *words.split(), *files], check=True, capture_output=True)
    return certificate, key


@pytest.fixture
def secure(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """The address of an https server that answers 404, and the root that its certificate comes from."""
    certificate, key = make_authority(tmp_path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    server = ScriptedServer(lambda _: Reply(404, raw=b""), context=context)
    yield f"https://localhost:{server.port}", certificate
    server.close()


def test_an_authority_of_ones_own_is_trusted_where_it_is_named(
    secure: tuple[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    url, root = secure
    with pytest.raises(UnreachableError, match=r"certificate is not trusted .*SSL_CERT_FILE may name a file"):
        Server(url).manifest("kfusion")

    monkeypatch.setenv("SSL_CERT_FILE", str(root))

    with pytest.raises(Exception, match="answers 404 Not Found"):
        Server(url).manifest("kfusion")
