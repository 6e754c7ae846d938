"""Reads of fronts."""

from django.db.models import QuerySet
from msgspec import to_builtins
from msgspec.structs import replace

from crowd.database.prepared import CompiledQuery
from crowd.fronts import trajectories
from crowd.fronts.models import Configuration, FrontVersion
from wire.front import ADAPTIVE, BEST, DEFAULT, Content, Front, Point, predicted_speedup

DEFAULT_APPLICATION = "kfusion"


def read(row: FrontVersion) -> Front:
    """The front of `row`."""
    return Front(row.state, row.digest, row.published_at, row.sequence, row.content)


def of_content(content: Content) -> Front:
    """A front that is not stored, of which the description of the pack is not known."""
    sequence = to_builtins(content.sequence)
    return Front(FrontVersion.State.DRAFT, "", None, sequence, content.with_each(trajectories.named))


def fronts(application: str | None = None) -> tuple[Front, ...]:
    """All released fronts, newest first. One query."""
    rows = FrontVersion.objects.released()
    if application is not None:
        rows = rows.filter(application=application)
    return tuple(read(row) for row in rows)


def names() -> tuple[tuple[str, str], ...]:
    """Slug and application of all released fronts, newest first. One query."""
    return tuple(_names.rows())


_names = CompiledQuery(lambda: FrontVersion.objects.released().values_list("slug", "application"))


def released(application: str) -> tuple[tuple[str, str], ...]:
    """Slug and digest of all released fronts of `application`, newest first. One query."""
    rows = FrontVersion.objects.released().filter(application=application)
    return tuple(rows.values_list("slug", "digest"))


def front(slug: str) -> Front | None:
    """The released front `slug`, or None. One query."""
    row = FrontVersion.objects.released().filter(slug=slug).first()
    return None if row is None else read(row)


def fastest_on_reference(slug: str) -> str:
    """Of what every client measures of the front `slug`, the configuration that is fastest on the reference.

    That is BEST, or ADAPTIVE where it is predicted to be faster. One query.
    """
    row = FrontVersion.objects.filter(slug=slug).first()
    if row is None:
        return BEST
    points = {point.name: point.predicted for point in row.content.configurations}
    best, adaptive = (
        (predicted_speedup(points.get(DEFAULT), points[name]) or 0.0) if name in points else 0.0
        for name in (BEST, ADAPTIVE)
    )
    return ADAPTIVE if adaptive > best else BEST


def key_of(slug: str) -> int:
    """The primary key of the front `slug`. Raises FrontVersion.DoesNotExist."""
    return FrontVersion.objects.values_list("pk", flat=True).get(slug=slug)


def configuration_names(slug: str) -> tuple[tuple[int, str], ...]:
    """Key and name of each configuration of the front `slug`, probes included. One query."""
    return tuple(Configuration.objects.filter(front__slug=slug).values_list("pk", "name"))


def front_in_any_state(key: int) -> Front:
    """The front with `key` in any state. One query. Raises FrontVersion.DoesNotExist."""
    return read(FrontVersion.objects.get(pk=key))


def content(front: Front) -> Content:
    """The content of `front` as its file has it, with the trajectories. One query if it has some."""
    digests = {point.trajectory_sha256 for point in front.content.every if point.trajectory_sha256}
    stored = trajectories.read(digests) if digests else {}

    def with_positions(point: Point) -> Point:
        positions = stored.get(point.trajectory_sha256 or "")
        return replace(point, trajectory=positions, trajectory_sha256=None, reference_ate=None)

    return front.content.with_each(with_positions)


def next_version(application: str) -> str:
    """The highest numeric version of `application` plus one."""
    versions = FrontVersion.objects.filter(application=application).values_list("version", flat=True)
    return str(max((int(version) for version in versions if version.isdecimal()), default=0) + 1)


def current(application: str) -> Front | None:
    """The front that clients of `application` measure now: the newest published one. One query."""
    row = _published(application).first()
    return None if row is None else read(row)


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
