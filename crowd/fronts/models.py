"""Fronts, their configurations, and the policy for accepting measurements."""

from collections.abc import Iterable
from typing import Any

from django.core.exceptions import ValidationError
from django.core.validators import RegexValidator
from django.db import models

from wire.front import Content, decoded

NAME = RegexValidator(
    r"\A[a-z0-9][a-z0-9_-]*\Z", "lower-case letters, digits, - and _, starting with a letter or digit"
)
VERSION = RegexValidator(r"\A[a-z0-9][a-z0-9._-]*\Z", "lower-case letters, digits, dots, - and _")
NUMBERS = RegexValidator(r"\A[0-9]{1,6}(\.[0-9]{1,6}){0,4}\Z", "numbers with dots, as 1.2.0")
# The fields that may change after the draft: the progress of the publication.
MUTABLE = frozenset({"state", "published_at", "retired_at"})


class FrozenFrontError(ValidationError):
    """A front that is not a draft cannot be changed or deleted; the remedy is a new version."""

    def __init__(self, front: str) -> None:
        super().__init__(
            f"{front} is not a draft any more and cannot change: make a new version", code="frozen"
        )


class TransitionError(ValidationError):
    """The state of a front does not allow this step; the message names the allowed ones."""

    def __init__(self, front: str, before: str, after: str) -> None:
        allowed = ", ".join(sorted(PERMITTED[before])) or "nothing"
        super().__init__(f"{front} is {before} and cannot become {after}: only {allowed}", code="transition")


class FrontVersionQuerySet(models.QuerySet["FrontVersion"]):
    """Refuses bulk changes of fronts that are not drafts."""

    def released(self) -> "FrontVersionQuerySet":
        """Published and retired fronts: only these are visible outside the administration."""
        return self.filter(state__in=[FrontVersion.State.PUBLISHED, FrontVersion.State.RETIRED])

    def _refuse_frozen(self) -> None:
        frozen = self.exclude(state=FrontVersion.State.DRAFT).values_list("slug", flat=True).first()
        if frozen is not None:
            raise FrozenFrontError(frozen)

    def update(self, **values: Any) -> int:
        self._refuse_frozen()
        if "state" in values:
            raise ValidationError("the state of a front changes row by row, so that each step is logged")
        return super().update(**values)

    def delete(self) -> tuple[int, dict[str, int]]:
        self._refuse_frozen()
        return super().delete()


class FrontVersion(models.Model):
    """A version of an application's front. It and its configurations are immutable once in review."""

    class State(models.TextChoices):
        DRAFT = "draft", "draft"
        IN_REVIEW = "in-review", "in review"
        PUBLISHED = "published", "published"
        RETIRED = "retired", "retired"

    slug = models.CharField(
        max_length=97, unique=True, help_text="application-version, the name in every address"
    )
    application = models.CharField(max_length=64, validators=[NAME])
    version = models.CharField(max_length=32, validators=[VERSION])
    state = models.CharField(max_length=16, choices=State.choices, default=State.DRAFT)
    digest = models.CharField(max_length=64, help_text="sha256 over the content's canonical JSON")
    document = models.TextField(help_text="the content as JSON, with the digests of its trajectories")
    sequence = models.JSONField(help_text="the pack that clients download, without addresses")
    created_at = models.DateTimeField(auto_now_add=True)
    published_at = models.DateTimeField(null=True, blank=True)
    retired_at = models.DateTimeField(null=True, blank=True)

    objects = FrontVersionQuerySet.as_manager()

    class Meta:
        ordering = ["-published_at", "-id"]
        permissions = [
            ("submit_frontversion", "Can make drafts and submit them for review"),
            ("publish_frontversion", "Can publish and retire fronts"),
        ]
        constraints = [
            models.UniqueConstraint(fields=["application", "version"], name="front_application_version"),
            models.CheckConstraint(
                condition=models.Q(state__in=["draft", "in-review"]) | models.Q(published_at__isnull=False),
                name="front_published_has_a_date",
            ),
            models.CheckConstraint(
                condition=models.Q(state__in=["draft", "in-review", "published", "retired"]),
                name="front_state_is_known",
            ),
        ]

    def __str__(self) -> str:
        return self.slug

    def save(self, *args: Any, **kwargs: Any) -> None:
        """Store. Raises FrozenFrontError if content changes after the draft, and TransitionError."""
        stored = FrontVersion.objects.filter(pk=self.pk).first() if self.pk else None
        if stored is not None and self.state != stored.state and self.state not in PERMITTED[stored.state]:
            raise TransitionError(self.slug, stored.state, self.state)
        if stored is not None and stored.state != self.State.DRAFT:
            changed = {
                field.attname
                for field in self._meta.concrete_fields
                if getattr(self, field.attname) != getattr(stored, field.attname)
            }
            # The dates of a state change together with it.
            if not changed <= (MUTABLE if "state" in changed else frozenset()):
                raise FrozenFrontError(self.slug)
        super().save(*args, **kwargs)

    def delete(self, *args: Any, **kwargs: Any) -> tuple[int, dict[str, int]]:
        """Delete a draft. Raises FrozenFrontError for other states."""
        if self.frozen:
            raise FrozenFrontError(self.slug)
        return super().delete(*args, **kwargs)

    @property
    def content(self) -> Content:
        """What it consists of."""
        return decoded(self.document)

    @property
    def frozen(self) -> bool:
        """Whether the stored row is not a draft."""
        stored = FrontVersion.objects.filter(pk=self.pk).values_list("state", flat=True).first()
        return stored is not None and stored != self.State.DRAFT


# Allowed transitions. A published front is never unpublished; a review may send a front back.
PERMITTED: dict[str, frozenset[str]] = {
    FrontVersion.State.DRAFT: frozenset({FrontVersion.State.IN_REVIEW}),
    FrontVersion.State.IN_REVIEW: frozenset({FrontVersion.State.DRAFT, FrontVersion.State.PUBLISHED}),
    FrontVersion.State.PUBLISHED: frozenset({FrontVersion.State.RETIRED}),
    FrontVersion.State.RETIRED: frozenset(),
}


class ConfigurationQuerySet(models.QuerySet["Configuration"]):
    """Refuses bulk changes of configurations whose fronts are not drafts."""

    def _refuse_frozen(self) -> None:
        frozen = (
            self.exclude(front__state=FrontVersion.State.DRAFT).values_list("front__slug", flat=True).first()
        )
        if frozen is not None:
            raise FrozenFrontError(frozen)

    def update(self, **values: Any) -> int:
        self._refuse_frozen()
        return super().update(**values)

    def delete(self) -> tuple[int, dict[str, int]]:
        self._refuse_frozen()
        return super().delete()

    def bulk_create(self, objs: Iterable[Any], *args: Any, **kwargs: Any) -> list[Any]:
        configurations = list(objs)
        for configuration in configurations:
            configuration.refuse_frozen()
        return super().bulk_create(configurations, *args, **kwargs)


class Trajectory(models.Model):
    """A reference trajectory, named by its digest, so immutable."""

    sha256 = models.CharField(
        primary_key=True, max_length=64, help_text="of the positions as they are stored"
    )
    positions = models.TextField(help_text="JSON: [x, y, z] of each frame, in metres in the volume's frame")

    class Meta:
        verbose_name_plural = "trajectories"

    def __str__(self) -> str:
        return self.sha256


class Configuration(models.Model):
    """What other rows refer to of a point or probe: the rest is in the document of its front."""

    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="configurations")
    name = models.CharField(max_length=64, validators=[NAME])
    position = models.PositiveSmallIntegerField(help_text="place in the published list, from 0")
    probe = models.BooleanField(
        default=False, help_text="no point of the front: measured only by clients that are asked to"
    )
    skipped = models.FloatField(
        null=True,
        blank=True,
        help_text="share of the counted frames that it left out on the reference; empty if it computes all",
    )
    trajectory = models.ForeignKey(
        Trajectory,
        on_delete=models.PROTECT,
        null=True,
        blank=True,
        related_name="configurations",
        help_text="the reference trajectory; empty in a draft",
    )

    objects = ConfigurationQuerySet.as_manager()

    class Meta:
        ordering = ["front_id", "position"]
        constraints = [
            models.UniqueConstraint(fields=["front", "name"], name="configuration_name"),
            models.UniqueConstraint(fields=["front", "position"], name="configuration_position"),
        ]

    def __str__(self) -> str:
        return f"{self.front.slug} {self.name}"

    def save(self, *args: Any, **kwargs: Any) -> None:
        """Store. Raises FrozenFrontError if the front is not a draft."""
        self.refuse_frozen()
        super().save(*args, **kwargs)

    def delete(self, *args: Any, **kwargs: Any) -> tuple[int, dict[str, int]]:
        """Delete from a draft. Raises FrozenFrontError if the front is not a draft."""
        self.refuse_frozen()
        return super().delete(*args, **kwargs)

    def refuse_frozen(self) -> None:
        """Raise FrozenFrontError if the front is not a draft."""
        front = FrontVersion.objects.filter(pk=self.front_id).exclude(state=FrontVersion.State.DRAFT).first()
        if front is not None:
            raise FrozenFrontError(front.slug)


class IntakePolicy(models.Model):
    """Whether measurements are accepted, and from which client versions. There is at most one row.

    Without it measurements are accepted, from every version.
    """

    ONLY = 1

    id = models.PositiveSmallIntegerField(primary_key=True, default=ONLY, editable=False)
    accepting = models.BooleanField(
        "measurements are accepted",
        default=True,
        help_text="If not, clients keep their results and try again later.",
    )
    message = models.CharField(
        max_length=300, blank=True, help_text="told to people whose clients are turned away: why, how long"
    )
    minimum_app_version = models.CharField(
        max_length=32,
        blank=True,
        validators=[NUMBERS],
        help_text="Older clients must update. Empty: every version may send.",
    )
    changed_at = models.DateTimeField(auto_now=True)

    class Meta:
        verbose_name = verbose_name_plural = "intake policy"
        constraints = [models.CheckConstraint(condition=models.Q(pk=1), name="intake_policy_only")]

    def __str__(self) -> str:
        return "Intake policy"
