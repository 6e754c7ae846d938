"""The server's manifest: a published front, a protocol, a sequence."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any

import msgspec

from client_kit.delivery.server import NotFrontrunnerError, ProblemError, Server, UnreachableError
from client_kit.device.sources import line
from client_kit.errors import CannotMeasureError, OutdatedError, UsageError
from client_kit.home import Home
from groundwork import __version__
from slam.devices.device import BACKENDS
from wire import front
from wire import manifest as answered
from wire.front import DEFAULT, Metres, disagreements
from wire.manifest import Assignment, ContentReference
from wire.protocol import MOST_RUNS, VERSION

ALL = "all"


class Protocol(front.Protocol, frozen=True, forbid_unknown_fields=False):
    """The measuring protocol. Members that this client does not know are ignored."""


class Configuration(answered.Configuration, frozen=True, kw_only=True):
    """A configuration as a published front has it; without `backends` it runs on all."""

    backends: tuple[str, ...] = BACKENDS
    band: Metres
    trajectory: ContentReference


class _Version(msgspec.Struct):
    version: int


class _Versioned(msgspec.Struct):
    protocol: _Version


class Manifest(answered.Manifest, frozen=True, kw_only=True, dict=True):
    """One answer of GET /manifest, checked.

    `assigned` are the configurations besides the default in a manifest for one device; if empty,
    `assigned_message` may give the reason.
    """

    configurations: tuple[Configuration, ...]
    protocol: Protocol
    assigned: tuple[Assignment, ...] = ()
    assigned_message: str | None = None

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "Manifest":
        """Raises NotFrontrunnerError, which names the bad member, or OutdatedError for another protocol."""
        try:
            version = msgspec.convert(document, _Versioned).protocol.version
            if version != VERSION:
                older = "the client" if version > VERSION else "the server"
                raise OutdatedError(
                    f"this client measures by protocol {VERSION}, the server by {version}: {older} must be "
                    "updated"
                )
            return msgspec.convert(document, cls)
        except msgspec.ValidationError as error:
            raise NotFrontrunnerError(f"the server's manifest is not understood: {error}") from error

    def __post_init__(self) -> None:
        """Raises ValueError for members that do not fit each other."""
        if DEFAULT not in self.by_name:
            raise ValueError(f"configurations lacks {DEFAULT}")
        for reason in disagreements(self.protocol, self.by_name):
            raise ValueError(f"protocol.{reason}")
        for one in self.assigned:
            if one.name not in self.by_name:
                raise ValueError(f"assigned names {one.name!r}, which configurations lacks")

    @cached_property
    def by_name(self) -> Mapping[str, Configuration]:
        """The configurations by their names."""
        return {configuration.name: configuration for configuration in self.configurations}

    def require_this_version(self) -> None:
        """Raises OutdatedError when the server wants a newer client."""
        if version_numbers(__version__) < version_numbers(self.minimum_app_version):
            raise OutdatedError(
                f"this client is version {__version__}, the server requires {self.minimum_app_version} "
                "or newer: update it"
            )

    def require_accepting(self) -> None:
        """Raises CannotMeasureError when the server asks clients to pause."""
        if not self.accepting:
            reason = line(self.message) or "try again another day"
            raise CannotMeasureError(f"the server does not accept measurements now: {reason}")

    def names(self, wanted: Sequence[str]) -> tuple[str, ...]:
        """The configurations `wanted`, each once; "all" means the whole front.

        Raises UsageError for a name that the front does not have.
        """
        names = list(dict.fromkeys(wanted))
        if ALL in names:
            index = names.index(ALL)
            names[index : index + 1] = [name for name in self.by_name if name not in names]
        unknown = [name for name in names if name not in self.by_name]
        if unknown:
            present = ", ".join(self.by_name)
            raise UsageError(f"the front has no configuration {unknown[0]!r}: choose from {present}, {ALL}")
        return tuple(names)

    def plans(self, wanted: Sequence[str] = ()) -> tuple[tuple[str, ...], ...]:
        """The sessions that measure `wanted`, each as `plan` does: more than one only if one is too small.

        Every session also measures the default.
        """
        names = self.names(wanted)
        others = [name for name in names if name != DEFAULT]
        most = MOST_RUNS // self.protocol.repeats - 1
        if len(others) <= most:
            return (self.plan(names),)
        parts = -(-len(others) // most)
        size = -(-len(others) // parts)
        return tuple(self.plan(others[at : at + size]) for at in range(0, len(others), size))

    def plan(self, wanted: Sequence[str] = ()) -> tuple[str, ...]:
        """The configurations' names in the order of their runs.

        They run forwards, then back, until each has the protocol's repeats: a steady drift then affects all
        equally, as in default, best, best, default. `wanted` replaces the protocol's configurations; the
        default always takes part as the baseline. Raises UsageError for a name that the front does not have,
        or for more runs than a session holds.
        """
        names = self.names(wanted) or self.protocol.order
        if set(names) | {DEFAULT} == set(self.protocol.order):
            round_ = self.protocol.order
        else:
            round_ = tuple(dict.fromkeys([DEFAULT, *names]))
        plan = round_
        while min(plan.count(name) for name in round_) < self.protocol.repeats:
            round_ = tuple(reversed(round_))
            plan += round_
        if len(plan) > MOST_RUNS:
            raise UsageError(
                f"{len(plan)} runs are more than the {MOST_RUNS} of a session: name fewer --configurations"
            )
        return plan


def fetch(server: Server, home: Home, application: str | None = None) -> tuple[Manifest, bool]:
    """The manifest of `application` (None: the server's choice), and whether it was fetched now.

    Without an answer the copy of the last visit is used: a device may measure offline and send later.
    Raises the server's errors when there is no such copy, or when waiting would not help.
    """
    name = _document_name(server.url, application)
    kept = home.read(name)
    try:
        answer = server.manifest(application, kept.get("etag"))
    except (UnreachableError, ProblemError) as error:
        if not kept or (isinstance(error, ProblemError) and not error.temporary):
            raise
        return Manifest.parse(kept["manifest"]), False
    if answer.status == 304 and kept:
        return Manifest.parse(kept["manifest"]), True
    document = answer.json()
    manifest = Manifest.parse(document)
    for each in {name, _document_name(server.url, manifest.application)}:
        home.write(each, {"server": server.url, "manifest": document, "etag": answer.headers.get("ETag")})
    return manifest, True


def stored_manifests(home: Home) -> dict[tuple[str, str], Manifest]:
    """The last manifest of every server visited, by the server's address and the application.

    Those of another protocol are left out: they were stored by another version of the client.
    """
    manifests = {}
    for path in sorted(home.path.glob("manifest-*.json")):
        kept = home.read(path.name)
        with suppress(OutdatedError):
            manifest = Manifest.parse(kept["manifest"])
            manifests[kept["server"], manifest.application] = manifest
    return manifests


def version_numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version such as 1.10.2, for comparing, up to the first part that is not a number."""
    leading = re.match(r"\d+(\.\d+)*", version)
    return tuple(int(part) for part in leading.group().split(".")) if leading else ()


def _document_name(server: str, application: str | None) -> str:
    if application is None:
        return f"default-{hashlib.sha256(server.encode()).hexdigest()[:16]}.json"
    return f"manifest-{hashlib.sha256(f'{server} {application}'.encode()).hexdigest()[:16]}.json"
