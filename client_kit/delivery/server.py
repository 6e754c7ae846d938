"""The server's HTTP interface as a client uses it, with typed answers and errors.

Redirects are not followed: a token must never travel to an address that the participant did not name.
Proxies and certificate roots come from the usual environment variables (HTTPS_PROXY, SSL_CERT_FILE).
"""

import email.utils
import http.client
import json
import math
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from email.message import Message
from typing import Any

import msgspec

from client_kit import APP
from client_kit.errors import ClientError, OutdatedError, UsageError
from groundwork import __version__
from wire.lease import LEASE_VERSION, LeaseRequest
from wire.session import Enrolment

TIMEOUT_SECONDS = 30.0
LARGEST_ANSWER = 4 * 2**20
LARGEST_EXPORT = 2**30
LONGEST_WAIT_SECONDS = 24 * 3600.0


class ServerError(ClientError):
    """The server gave no usable answer; the request may be repeated."""


class UnreachableError(ServerError):
    """No connection, no answer in time, or an incomplete answer."""


class NotFrontrunnerError(ServerError):
    """The answer is not from a Frontrunner server, for instance from a hotel's log-in page."""


class ProblemError(ServerError):
    """An error answer of the server (RFC 9457): `code` is stable, `reason` is for people.

    `retry_after` is the wait that the server asks for, in seconds, or None; `field` the wrong member.
    """

    def __init__(
        self,
        status: int,
        code: str,
        reason: str,
        retry_after: float | None = None,
        field: str | None = None,
    ) -> None:
        super().__init__(f"{reason} ({code})" if reason else code)
        self.status = status
        self.code = code
        self.reason = reason
        self.retry_after = retry_after
        self.field = field

    @property
    def temporary(self) -> bool:
        """Whether the same request may succeed later: too many requests, or a server error."""
        return self.status == 429 or self.status >= 500


@dataclass(frozen=True)
class Answer:
    """A successful answer; `status` may be 304, with no body."""

    status: int
    headers: Message
    body: bytes

    def json(self) -> dict[str, Any]:
        """The body as a JSON object. Raises NotFrontrunnerError."""
        try:
            document = msgspec.json.decode(self.body)
        except msgspec.DecodeError as error:
            raise NotFrontrunnerError(f"the answer is not JSON: {self.body[:60]!r}") from error
        if not isinstance(document, dict):
            raise NotFrontrunnerError(f"the answer is not a JSON object: {self.body[:60]!r}")
        return document


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any, **__: Any) -> None:
        return None


class Server:
    """A Frontrunner server. Every method may raise ServerError or OutdatedError."""

    def __init__(self, url: str, *, timeout: float = TIMEOUT_SECONDS) -> None:
        """Raises UsageError when `url` is not an http or https address."""
        try:
            parts = urllib.parse.urlsplit(url if "://" in url else f"//{url}")
            parts.netloc.rpartition("@")[2].encode("idna")
            if not (url.isprintable() and parts.path.isascii()) or " " in url or parts.port == 0:
                raise ValueError("it has characters, or a port, that no address has")
        except ValueError as error:
            raise UsageError(f"--server {url!r} is not an address: {error}") from error
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise UsageError(f"--server {url}: give an address such as https://frontrunner.example")
        if parts.username or parts.query or parts.fragment:
            raise UsageError(f"--server {url}: give the address without user, query or fragment")
        self.url = f"{parts.scheme}://{parts.netloc}{parts.path.rstrip('/')}"
        self._timeout = timeout
        self._open = urllib.request.build_opener(_NoRedirect).open
        self._through = _through_proxy(parts.scheme, parts.hostname)

    def manifest(self, application: str | None, etag: str | None = None) -> Answer:
        """The published front, of the server's choice where `application` is None, with its protocol and
        sequence; status 304 when `etag` still holds."""
        query = "" if application is None else f"?{urllib.parse.urlencode({'application': application})}"
        headers = {"If-None-Match": etag} if etag else {}
        return self._call("GET", f"/manifest{query}", headers=headers)

    def assigned_manifest(self, token: str, application: str, minutes: float) -> dict[str, Any]:
        """A manifest of the configurations that the server assigns to this installation for `minutes`."""
        query = urllib.parse.urlencode({"application": application, "minutes": f"{minutes:g}"})
        return self._call("GET", f"/manifest?{query}", token=token).json()

    def recommendation(self, application: str, token: str | None = None) -> dict[str, Any]:
        """The crowd's predictions for this device: the recommended configuration, and the whole front. Raises
        ProblemError 404 where there is none."""
        query = urllib.parse.urlencode({"application": application})
        return self._call("GET", f"/recommendation?{query}", token=token).json()

    def enrol(self, consent_version: int) -> tuple[str, str]:
        """A new anonymous installation: its id and its token, which the server shows only once."""
        body = msgspec.json.encode(Enrolment(APP, __version__, consent_version))
        answer = self._call("POST", "/enrol", body=body).json()
        try:
            return str(answer["installation_id"]), str(answer["token"])
        except KeyError as error:
            raise NotFrontrunnerError(f"the answer to an enrolment lacks {error}") from error

    def submit(self, token: str, key: str, body: bytes) -> dict[str, Any]:
        """Send gzipped JSON under an idempotency key; repeated requests get the same answer."""
        headers = {"Content-Encoding": "gzip", "Idempotency-Key": key}
        return self._call("POST", "/submissions", token=token, body=body, headers=headers).json()

    def submission(self, token: str, submission_id: str) -> dict[str, Any]:
        """The state of a submission."""
        quoted = urllib.parse.quote(submission_id, safe="")
        return self._call("GET", f"/submissions/{quoted}", token=token).json()

    def own_data(self, token: str) -> dict[str, Any]:
        """All data of this installation on the server."""
        return self._call("GET", "/me/data", token=token, largest=LARGEST_EXPORT).json()

    def erase(self, token: str) -> None:
        """Erase all data of this installation."""
        self._call("DELETE", "/me", token=token)

    def erase_run(self, token: str, run: str) -> None:
        """Erase one run of this installation. Raises ProblemError 404 for an unknown id."""
        self._call("DELETE", f"/me/runs/{urllib.parse.quote(run, safe='')}", token=token)

    def renew_token(self, token: str) -> str:
        """A new token of this installation; `token` works until the new one is first used."""
        answer = self._call("POST", "/me/token", token=token, body=b"{}").json()
        try:
            return str(answer["token"])
        except KeyError as error:
            raise NotFrontrunnerError(f"the answer to a token's renewal lacks {error}") from error

    def validate(self, token: str, body: bytes) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """The dry run of a submission, plain JSON: the verdict on each run, and the state of each
        configuration; nothing is stored."""
        answer = self._call("POST", "/submissions:validate", token=token, body=body).json()
        try:
            return list(answer["items"]), list(answer["judged"])
        except (KeyError, TypeError) as error:
            raise NotFrontrunnerError(f"the answer to a dry run is malformed: {error!r}") from error

    def speedups(self, front: str, configuration: str) -> list[dict[str, Any]]:
        """The crowd's speedups of one configuration, a row for each device and backend, fastest first."""
        query = urllib.parse.urlencode({"front": front, "configuration": configuration, "limit": 1000})
        try:
            return list(self._call("GET", f"/speedups?{query}").json()["results"])
        except (KeyError, TypeError) as error:
            raise NotFrontrunnerError(f"the crowd's speedups are not understood: {error!r}") from error

    def lease(self, token: str, device: str, worker: str) -> dict[str, Any] | None:
        """The next evaluation for a reference device, or None."""
        request = LeaseRequest(device, worker, LEASE_VERSION)
        answer = self._call("POST", "/leases", token=token, body=msgspec.json.encode(request))
        return None if answer.status == 204 else answer.json()

    def heartbeat(self, token: str, lease: str) -> None:
        """Extend a lease. Raises ProblemError 410 where it is gone."""
        self._call("POST", f"/leases/{urllib.parse.quote(lease, safe='')}/heartbeat", token=token, body=b"{}")

    def finish(self, token: str, lease: str, result: Mapping[str, Any]) -> None:
        """Report the outcome of an evaluation. Raises ProblemError 410 where the lease is gone."""
        path = f"/leases/{urllib.parse.quote(lease, safe='')}/result"
        self._call("POST", path, token=token, body=json.dumps(result).encode())

    def download(self, address: str, size: int | None = None) -> bytes:
        """A file at an address from the manifest, relative or absolute: exactly `size` bytes if known, else
        at most LARGEST_ANSWER."""
        request = urllib.request.Request(urllib.parse.urljoin(f"{self.url}/", address))
        body = self._exchange(request, LARGEST_ANSWER if size is None else size).body
        if size is not None and len(body) != size:
            raise UnreachableError(f"{request.full_url} gave {len(body)} bytes instead of {size}")
        return body

    def page(self, path: str) -> str:
        """The address of a page for people."""
        return f"{self.url}/{path.lstrip('/')}"

    def _call(
        self,
        method: str,
        path: str,
        *,
        token: str | None = None,
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        largest: int = LARGEST_ANSWER,
    ) -> Answer:
        request = urllib.request.Request(f"{self.url}/api/v1{path}", data=body, method=method)
        request.add_header("Accept", "application/json")
        if body is not None:
            request.add_header("Content-Type", "application/json")
        if token is not None:
            request.add_header("Authorization", f"Bearer {token}")
        for name, value in (headers or {}).items():
            request.add_header(name, value)
        return self._exchange(request, largest)

    def _exchange(self, request: urllib.request.Request, largest: int) -> Answer:
        request.add_header("User-Agent", f"frontrunner-{APP}/{__version__}")
        try:
            with self._open(request, timeout=self._timeout) as response:
                body = response.read(largest + 1)
                if len(body) > largest:
                    raise NotFrontrunnerError(f"{self.url} answers with more than {largest} bytes")
                # read(n) does not raise when the connection is lost: it returns what came before.
                if len(body) < int(response.headers.get("Content-Length") or 0):
                    raise UnreachableError(f"{self.url} broke off its answer")
                return Answer(response.status, response.headers, body)
        except urllib.error.HTTPError as error:
            with error:
                if error.code == 304:
                    return Answer(304, error.headers, b"")
                raise self._refusal(error) from error
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise UnreachableError(
                f"{self.url} cannot be reached{self._through}: {_message(error)}"
            ) from error

    def _refusal(self, error: urllib.error.HTTPError) -> ClientError:
        try:
            body = error.read(LARGEST_ANSWER)
        except (OSError, http.client.HTTPException) as broken:
            return UnreachableError(f"{self.url} broke off its answer: {broken}")
        if error.code == 407:
            return UnreachableError(
                f"{self.url} cannot be reached{self._through}, which asks for a user: write its address "
                "as http://NAME:PASSWORD@HOST:PORT"
            )
        location = error.headers.get("Location")
        if 300 <= error.code < 400:
            return NotFrontrunnerError(
                f"{self.url} redirects to {location}: give that server's address instead"
            )
        retry_after = _seconds(error.headers.get("Retry-After"))
        try:
            problem = json.loads(body)
            code = str(problem["code"])
        except (ValueError, KeyError, TypeError):
            if error.code == 429 or error.code >= 500:
                return ProblemError(
                    error.code, f"http_{error.code}", f"{self.url} {error.reason}", retry_after
                )
            return NotFrontrunnerError(
                f"{self.url} answers {error.code} {error.reason}{self._through}, unlike a Frontrunner server"
            )
        reason = str(problem.get("detail") or problem.get("title") or "")
        if error.code == 426:
            return OutdatedError(
                f"this client, version {__version__}, is too old for {self.url}: {reason or code}"
            )
        field = problem.get("field")
        return ProblemError(error.code, code, reason, retry_after, None if field is None else str(field))


def _through_proxy(scheme: str, host: str) -> str:
    """ " through the proxy HOST:PORT", without its user, or "" where none is used."""
    address = urllib.request.getproxies().get(scheme)
    if not address or urllib.request.proxy_bypass(host):
        return ""
    where = address.rpartition("://")[2].rpartition("@")[2].rstrip("/")
    return f" through the proxy {where} ({scheme.upper()}_PROXY)"


def _message(error: Exception) -> str:
    """The network error as a message for people."""
    reason = getattr(error, "reason", None) or error
    if isinstance(reason, ssl.SSLCertVerificationError):
        return (
            f"its certificate is not trusted ({reason.verify_message}); SSL_CERT_FILE may name a file with "
            "the roots of your own authority"
        )
    return getattr(reason, "strerror", None) or str(reason) or type(reason).__name__


def _seconds(value: str | None) -> float | None:
    """Retry-After, in seconds or as a date, as seconds from now; None when absent or unreadable."""
    if value is None:
        return None
    try:
        seconds = float(value)
    except ValueError:
        try:
            seconds = email.utils.parsedate_to_datetime(value).timestamp() - time.time()
        except ValueError:
            return None
    return min(max(seconds, 0.0), LONGEST_WAIT_SECONDS) if math.isfinite(seconds) else None
