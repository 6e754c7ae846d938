"""Reads of fronts."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from django.db.models import QuerySet

from crowd.database.prepared import CompiledQuery
from crowd.fronts import trajectories
from crowd.fronts.models import Configuration, FrontVersion

DEFAULT = "default"
BEST = "best"
ADAPTIVE = "adaptive"  # the fastest that leaves out frames, which every client measures, too
DEFAULT_APPLICATION = "kfusion"
POINT_MEMBERS = (
    *(
        "name",
        "parameters",
        "predicted",
        "band",
        "skipped",
        "program",
        "not_told_apart",
        "learned_on",
        "held_out",
    ),
)


@dataclass(frozen=True)
class Point:
    """A configuration of a front, with predictions by the reference device (seconds, metres).

    After its preparation: `band`, the allowed distance (m) from the reference trajectory, the digest of the
    trajectory, the share of the counted frames that was `skipped` there (None if all are computed), the
    digest of the `program` that made it (None without a plan), and the points `not_told_apart` from it by
    time. `learned_on` and `held_out`: [{sequence, ate_max (m), lost (frames)}], the worst on each sequence.
    `ate_max`: the largest error on the sequences learned on, as predicted, or as measured where that is
    larger; None if tracking was lost. Limits apply to it.
    """

    name: str
    parameters: dict[str, Any]
    runtime: float | None
    ate_max: float | None
    ate_mean: float | None
    predicted: dict[str, Any]
    band: float | None = None
    skipped: float | None = None
    trajectory_sha256: str | None = None
    program: str | None = None
    not_told_apart: tuple[str, ...] = ()
    learned_on: tuple[Mapping[str, Any], ...] = ()
    held_out: tuple[Mapping[str, Any], ...] = ()

    @property
    def held_out_ate_max(self) -> float | None:
        """The largest error (m) on the held-out sequences. None where it was not measured on any."""
        return max((result["ate_max"] for result in self.held_out), default=None)


def predicted_interval(own: Mapping[str, Any]) -> tuple[float, float] | None:
    """The 95 % interval of the predicted speedup on the clients' sequence; None before the preparation."""
    if (times := own.get("on_sequence")) is None:
        return None
    return 1 / float(times["high"]), 1 / float(times["low"])


def predicted_speedup(default: Mapping[str, Any], own: Mapping[str, Any]) -> float | None:
    """The predicted speedup over `default`; None if a runtime is unknown.

    That on the clients' sequence, once it was prepared. Before, ratios to the default of the same round are
    used if both are known, because they do not depend on varying load of the host.
    """
    if (times := own.get("on_sequence")) is not None:
        return 1 / float(times["runtime_ratio"])
    both = "runtime_ratio" in default and "runtime_ratio" in own
    name = "runtime_ratio" if both else "runtime"
    before, after = default.get(name), own.get(name)
    return before / after if before and after else None


@dataclass(frozen=True)
class Front:
    """A front with its points in published order; `published_at` is None before its publication.

    `probes` are further configurations, measured only by clients that are asked to.
    """

    slug: str
    application: str
    version: str
    state: str
    digest: str
    published_at: datetime | None
    protocol: dict[str, Any]
    sequence: dict[str, Any]
    provenance: dict[str, Any]
    points: tuple[Point, ...]
    probes: tuple[Point, ...] = ()

    def point(self, name: str) -> Point | None:
        """The configuration `name`, or None."""
        return next((point for point in self.points if point.name == name), None)

    @property
    def sequence_names(self) -> tuple[list[str], list[str]]:
        """The sequences with results that it was learned on (else that of clients), and the held-out ones."""
        learned, held_out = (
            list(dict.fromkeys(one["sequence"] for point in self.points for one in getattr(point, kind)))
            for kind in ("learned_on", "held_out")
        )
        return learned or [self.sequence["name"]], held_out


def _front(row: FrontVersion) -> Front:
    stored = list(row.configurations.all())
    return Front(
        slug=row.slug,
        application=row.application,
        version=row.version,
        state=row.state,
        digest=row.digest,
        published_at=row.published_at,
        protocol=row.protocol,
        sequence=row.sequence,
        provenance=row.provenance,
        points=tuple(_stored_point(one) for one in stored if not one.probe),
        probes=tuple(_stored_point(one) for one in stored if one.probe),
    )


def _stored_point(row: Configuration) -> Point:
    return _point({name: getattr(row, name) for name in POINT_MEMBERS}, row.trajectory_id)


def _point_from_file(point: Mapping[str, Any]) -> Point:
    positions = point.get("trajectory")
    return _point(point, positions and trajectories.digest(trajectories.encode(positions)))


def _point(members: Mapping[str, Any], trajectory_sha256: str | None) -> Point:
    predicted = members["predicted"]
    learned_on = tuple(members.get("learned_on", ()))
    ate_max = predicted.get("ate_max")  # None: tracking was lost
    if ate_max is not None:
        ate_max = max([ate_max, *(result["ate_max"] for result in learned_on)])
    return Point(
        name=members["name"],
        parameters=members["parameters"],
        runtime=predicted.get("runtime"),
        ate_max=ate_max,
        ate_mean=predicted.get("ate_mean"),
        predicted=predicted,
        band=members.get("band"),
        skipped=members.get("skipped"),
        trajectory_sha256=trajectory_sha256,
        program=members.get("program") or None,
        not_told_apart=tuple(members.get("not_told_apart", ())),
        learned_on=learned_on,
        held_out=tuple(members.get("held_out", ())),
    )


def fronts(application: str | None = None) -> tuple[Front, ...]:
    """All released fronts, newest first. Two queries."""
    rows = FrontVersion.objects.released().prefetch_related("configurations")
    if application is not None:
        rows = rows.filter(application=application)
    return tuple(_front(row) for row in rows)


def names() -> tuple[tuple[str, str], ...]:
    """Slug and application of all released fronts, newest first. One query."""
    return tuple(_names.rows())


_names = CompiledQuery(lambda: FrontVersion.objects.released().values_list("slug", "application"))


def released(application: str) -> tuple[tuple[str, str], ...]:
    """Slug and digest of all released fronts of `application`, newest first. One query."""
    rows = FrontVersion.objects.released().filter(application=application)
    return tuple(rows.values_list("slug", "digest"))


def front(slug: str) -> Front | None:
    """The released front `slug`, or None. Two queries."""
    row = FrontVersion.objects.released().prefetch_related("configurations").filter(slug=slug).first()
    return None if row is None else _front(row)


def fastest_on_reference(slug: str) -> str:
    """Of what every client measures of the front `slug`, the configuration that is fastest on the reference.

    That is BEST, or ADAPTIVE where it is predicted to be faster. One query.
    """
    named = Configuration.objects.filter(front__slug=slug, name__in=(DEFAULT, BEST, ADAPTIVE))
    predicted = dict(named.values_list("name", "predicted"))
    default = predicted.get(DEFAULT, {})
    best, adaptive = (predicted_speedup(default, predicted.get(name, {})) or 0.0 for name in (BEST, ADAPTIVE))
    return ADAPTIVE if adaptive > best else BEST


def key_of(slug: str) -> int:
    """The primary key of the front `slug`. Raises FrontVersion.DoesNotExist."""
    return FrontVersion.objects.values_list("pk", flat=True).get(slug=slug)


def configuration_names(slug: str) -> tuple[tuple[int, str], ...]:
    """Key and name of each configuration of the front `slug`, probes included. One query."""
    return tuple(Configuration.objects.filter(front__slug=slug).values_list("pk", "name"))


def front_in_any_state(key: int) -> Front:
    """The front with `key` in any state. Two queries. Raises FrontVersion.DoesNotExist."""
    return _front(FrontVersion.objects.prefetch_related("configurations").get(pk=key))


def front_from_document(document: Mapping[str, Any]) -> Front:
    """The front of `document`, a checked front file; it is not stored."""
    application, version = document["application"], str(document["version"])
    return Front(
        slug=f"{application}-{version}",
        application=application,
        version=version,
        state=FrontVersion.State.DRAFT,
        digest="",
        published_at=None,
        protocol=document["protocol"],
        sequence=document["sequence"],
        provenance=document["provenance"],
        points=tuple(map(_point_from_file, document["configurations"])),
        probes=tuple(map(_point_from_file, document.get("probes", ()))),
    )


def document(front: Front) -> dict[str, Any]:
    """The stored `front` in the format of a front file, with the same digest.

    One query if it has reference trajectories.
    """
    every = (*front.points, *front.probes)
    digests = {point.trajectory_sha256 for point in every if point.trajectory_sha256}
    stored = trajectories.read(digests) if digests else {}

    def described(point: Point) -> dict[str, Any]:
        members: dict[str, Any] = {
            "name": point.name,
            "parameters": point.parameters,
            "predicted": point.predicted,
        }
        if point.band is not None:
            members["band"] = point.band
        if point.skipped is not None:
            members["skipped"] = point.skipped
        if point.trajectory_sha256:
            members["trajectory"] = stored[point.trajectory_sha256]
        others: dict[str, Any] = {"program": point.program, "not_told_apart": list(point.not_told_apart)}
        others |= {"learned_on": list(point.learned_on), "held_out": list(point.held_out)}
        return members | {name: value for name, value in others.items() if value}

    return {
        "application": front.application,
        "version": front.version,
        "protocol": front.protocol,
        "sequence": sequence_reference(front.sequence),
        "configurations": [described(point) for point in front.points],
        "provenance": front.provenance,
    } | ({"probes": [described(point) for point in front.probes]} if front.probes else {})


def sequence_reference(sequence: Mapping[str, Any]) -> dict[str, str]:
    """`sequence` of a manifest in the format of a front file."""
    colour = {"colour_sha256": sequence["colour"]["sha256"]} if "colour" in sequence else {}
    return {name: sequence[name] for name in ("name", "sha256")} | colour


def next_version(application: str) -> str:
    """The highest numeric version of `application` plus one."""
    versions = FrontVersion.objects.filter(application=application).values_list("version", flat=True)
    return str(max((int(version) for version in versions if version.isdecimal()), default=0) + 1)


def current(application: str) -> Front | None:
    """The front that clients of `application` measure now: the newest published one. Two queries."""
    row = _published(application).prefetch_related("configurations").first()
    return None if row is None else _front(row)


def measured_now() -> dict[str, str]:
    """The front that clients measure now, by application. One query."""
    published = FrontVersion.objects.filter(state=FrontVersion.State.PUBLISHED)
    newest: dict[str, str] = {}
    for application, slug in published.values_list("application", "slug"):
        newest.setdefault(application, slug)
    return newest


def current_name(application: str | None) -> tuple[str, str] | None:
    """Slug and digest of the current front. One query.

    Without `application`, that of DEFAULT_APPLICATION; if it has none, of the application that was published
    first.
    """
    if application is not None:
        return _published(application).values_list("slug", "digest").first()
    published = FrontVersion.objects.filter(state=FrontVersion.State.PUBLISHED)
    newest: dict[str, tuple[str, str]] = {}
    for name, slug, digest in published.values_list("application", "slug", "digest"):
        newest.setdefault(name, (slug, digest))
        oldest = name
    if not newest:
        return None
    return newest[DEFAULT_APPLICATION if DEFAULT_APPLICATION in newest else oldest]


def _published(application: str) -> QuerySet[FrontVersion]:
    return FrontVersion.objects.filter(application=application, state=FrontVersion.State.PUBLISHED)
