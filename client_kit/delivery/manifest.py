"""The server's manifest: a published front, a protocol, a sequence."""

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from client_kit.delivery.server import NotFrontrunnerError, ProblemError, Server, UnreachableError
from client_kit.device.sources import line
from client_kit.errors import CannotMeasureError, OutdatedError, UsageError
from client_kit.home import Home
from groundwork import __version__
from slam.devices.device import BACKENDS
from wire.protocol import MOST_RUNS, VALID_BELOW, VERSION

DIGEST = re.compile(r"[0-9a-f]{64}")
ALL = "all"


@dataclass(frozen=True)
class Protocol:
    """The measuring protocol. Frames are counted from 0; times of frames before `first_counted_frame` are
    sent but do not count. `order` names the runs of a session; every configuration gets `repeats` of them.
    """

    version: int
    warmup_frames: int
    frames: int
    first_counted_frame: int
    order: tuple[str, ...]
    repeats: int
    rest_seconds: float
    max_ate: float


@dataclass(frozen=True)
class Reference:
    """The reference trajectory of a configuration: the digest of its JSON, and its address."""

    sha256: str
    url: str


@dataclass(frozen=True)
class Configuration:
    """A point of the front; `predicted` holds the reference device's runtime (s) and ATE (m).

    `band`: how far (m) a run may be from the trajectory `reference`. `backends` are those that can run it.
    """

    name: str
    parameters: Mapping[str, Any]
    predicted: Mapping[str, Any]
    band: float
    reference: Reference
    backends: tuple[str, ...] = BACKENDS


@dataclass(frozen=True)
class Chunk:
    """A part of the sequence: `bytes` long, with this digest, at this address."""

    sha256: str
    bytes: int
    url: str


@dataclass(frozen=True)
class Assigned:
    """A configuration that the server asks this device to measure; `why` is a sentence for people."""

    name: str
    why: str


@dataclass(frozen=True)
class Manifest:
    """One answer of GET /manifest, checked. `document` is the answer itself.

    `chunks` are those of the sequence's depth, `colour` those of its colour, empty where not needed.
    `assigned` are the configurations besides the default in a manifest for one device; if empty,
    `assigned_message` may give the reason.
    """

    application: str
    front_version: str | int
    configurations: Mapping[str, Configuration]
    protocol: Protocol
    chunks: tuple[Chunk, ...]
    colour: tuple[Chunk, ...]
    sequence: Mapping[str, Any]
    consent_version: str | int
    minimum_app_version: str
    accepting: bool
    assigned: tuple[Assigned, ...]
    assigned_message: str | None
    document: Mapping[str, Any]

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "Manifest":
        """Raises NotFrontrunnerError, which names the bad member, or OutdatedError for another protocol."""
        try:
            return _parse(document)
        except KeyError as error:
            raise NotFrontrunnerError(f"the server's manifest lacks {error}") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise NotFrontrunnerError(f"the server's manifest is not understood: {error}") from error

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
            reason = line(self.document.get("message")) or "try again another day"
            raise CannotMeasureError(f"the server does not accept measurements now: {reason}")

    def names(self, wanted: Sequence[str]) -> tuple[str, ...]:
        """The configurations `wanted`, each once; "all" means the whole front.

        Raises UsageError for a name that the front does not have.
        """
        names = list(dict.fromkeys(wanted))
        if ALL in names:
            index = names.index(ALL)
            names[index : index + 1] = [name for name in self.configurations if name not in names]
        unknown = [name for name in names if name not in self.configurations]
        if unknown:
            present = ", ".join(self.configurations)
            raise UsageError(f"the front has no configuration {unknown[0]!r}: choose from {present}, {ALL}")
        return tuple(names)

    def plans(self, wanted: Sequence[str] = ()) -> tuple[tuple[str, ...], ...]:
        """The sessions that measure `wanted`, each as `plan` does: more than one only if one is too small.

        Every session also measures the default.
        """
        names = self.names(wanted)
        others = [name for name in names if name != "default"]
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
        if set(names) | {"default"} == set(self.protocol.order):
            round_ = self.protocol.order
        else:
            round_ = tuple(dict.fromkeys(["default", *names]))
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


def _parse(document: Mapping[str, Any]) -> Manifest:
    points, version = document["configurations"], int(document["protocol"]["version"])
    if version != VERSION:
        older = "the client" if version > VERSION else "the server"
        raise OutdatedError(
            f"this client measures by protocol {VERSION}, the server by {version}: {older} must be updated"
        )
    configurations = [_configuration(described) for described in points]
    by_name = {configuration.name: configuration for configuration in configurations}
    if "default" not in by_name:
        raise KeyError("configurations: default")
    sequence = document["sequence"]
    chunks, colour = read_sequence(sequence)
    return Manifest(
        application=str(document["application"]),
        front_version=document["front_version"],
        configurations=by_name,
        protocol=_protocol(document["protocol"], by_name),
        chunks=chunks,
        colour=colour,
        sequence=sequence,
        consent_version=document["consent_version"],
        minimum_app_version=str(document["minimum_app_version"]),
        accepting=document["accepting"] is True,
        assigned=_assigned(document.get("assigned") or (), by_name),
        assigned_message=line(document.get("assigned_message")),
        document=document,
    )


def _assigned(
    described: Sequence[Mapping[str, Any]], configurations: Mapping[str, Configuration]
) -> tuple[Assigned, ...]:
    assigned = tuple(Assigned(str(one["name"]), line(one["why"]) or "") for one in described)
    unknown = [one.name for one in assigned if one.name not in configurations]
    if unknown:
        raise ValueError(f"assigned names {unknown[0]!r}, which configurations lacks")
    return assigned


def _configuration(described: Mapping[str, Any]) -> Configuration:
    name, backends = str(described["name"]), described.get("backends")
    band, trajectory = float(described["band"]), described["trajectory"]
    reference = Reference(str(trajectory["sha256"]), str(trajectory["url"]))
    # The digest becomes a file name.
    if not (math.isfinite(band) and band > 0 and DIGEST.fullmatch(reference.sha256)):
        raise ValueError(f"configurations: {name} has band {band} and trajectory {reference.sha256!r}")
    return Configuration(
        name,
        dict(described["parameters"]),
        dict(described.get("predicted") or {}),
        band,
        reference,
        BACKENDS if backends is None else tuple(map(str, backends)),
    )


def _protocol(protocol: Mapping[str, Any], configurations: Mapping[str, Configuration]) -> Protocol:
    order = tuple(str(name) for name in protocol["order"])
    unknown = [name for name in order if name not in configurations]
    if unknown or "default" not in order:
        raise ValueError(f"protocol.order {list(order)} lacks default or has an unknown name")
    warmup, frames, first = (
        int(protocol[name]) for name in ("warmup_frames", "frames", "first_counted_frame")
    )
    rest = float(protocol["rest_seconds"])
    if not (warmup >= 0 and 0 <= first < frames and math.isfinite(rest) and rest >= 0):
        raise ValueError(f"protocol {dict(protocol)} is out of range")
    # An order such as default, best, best, default lists its repeats explicitly.
    repeats = max(int(protocol["repeats"]), order.count("default"))
    runs = -(-repeats // min(order.count(name) for name in order)) * len(order)
    # The default and any one other configuration must fit into a session, too.
    if max(runs, 2 * repeats) > MOST_RUNS:
        raise ValueError(f"protocol.repeats {repeats} of {list(order)} are more than {MOST_RUNS} runs")
    return Protocol(
        version=int(protocol["version"]),
        warmup_frames=warmup,
        frames=frames,
        first_counted_frame=first,
        order=order,
        repeats=repeats,
        rest_seconds=rest,
        max_ate=float(protocol.get("max_ate", VALID_BELOW)),
    )


def read_sequence(sequence: Mapping[str, Any]) -> tuple[tuple[Chunk, ...], tuple[Chunk, ...]]:
    """The chunks of `sequence` and of its colour, checked; the latter empty without colour.

    Raises KeyError, TypeError or ValueError for invalid ones.
    """
    return _chunks(sequence, "sequence"), _chunks(sequence.get("colour"), "sequence.colour")


def _chunks(pack: Mapping[str, Any] | None, member: str) -> tuple[Chunk, ...]:
    if pack is None:
        return ()
    if not DIGEST.fullmatch(pack["sha256"]):
        raise ValueError(f"{member}.sha256 is {pack['sha256']!r}, not 64 hexadecimal digits")
    return tuple(_chunk(chunk, member) for chunk in pack["chunks"])


def _chunk(chunk: Mapping[str, Any], member: str) -> Chunk:
    digest, size = str(chunk["sha256"]), int(chunk["bytes"])
    # The digest becomes a file name.
    if not DIGEST.fullmatch(digest) or size <= 0:
        raise ValueError(f"{member} chunk {digest!r} of {size} bytes")
    return Chunk(digest, size, str(chunk["url"]))
