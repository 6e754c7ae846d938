"""A front as it was learned on one reference device, and the configurations on it that the crowd measures."""

from collections.abc import Iterable
from typing import Any

from django.core.exceptions import ValidationError
from django.core.validators import RegexValidator
from django.db import models

NAME = RegexValidator(
    r"\A[a-z0-9][a-z0-9_-]*\Z", "lower-case letters, digits, - and _, starting with a letter or digit"
)
VERSION = RegexValidator(r"\A[a-z0-9][a-z0-9._-]*\Z", "lower-case letters, digits, dots, - and _")
# What may still change once a version is out: whether clients are told to measure it.
MUTABLE = frozenset({"state", "retired_at"})


class FrozenFrontError(ValidationError):
    """An attempt to change or delete what is published; the remedy is a new version."""

    def __init__(self, front: str) -> None:
        super().__init__(
            f"{front} is published and cannot change: publish a new version instead", code="frozen"
        )


class FrontVersionQuerySet(models.QuerySet["FrontVersion"]):
    """Holds published rows fixed against bulk statements too."""

    def _refuse_frozen(self) -> None:
        frozen = self.exclude(state=FrontVersion.State.DRAFT).values_list("slug", flat=True).first()
        if frozen is not None:
            raise FrozenFrontError(frozen)

    def update(self, **values: Any) -> int:
        if not MUTABLE.issuperset(values):
            self._refuse_frozen()
        return super().update(**values)

    def delete(self) -> tuple[int, dict[str, int]]:
        self._refuse_frozen()
        return super().delete()


class FrontVersion(models.Model):
    """One version of an application's front: fixed, with its configurations, once it is published."""

    class State(models.TextChoices):
        DRAFT = "draft"
        PUBLISHED = "published"
        RETIRED = "retired"

    slug = models.CharField(
        max_length=97, unique=True, help_text="application-version, the name in every address"
    )
    application = models.CharField(max_length=64, validators=[NAME])
    version = models.CharField(max_length=32, validators=[VERSION])
    state = models.CharField(max_length=16, choices=State.choices, default=State.DRAFT)
    digest = models.CharField(max_length=64, help_text="sha256 over the content's canonical JSON")
    protocol = models.JSONField(help_text="how clients measure: warm-up, frames, order, rest")
    sequence = models.JSONField(help_text="the pack that clients download, without addresses")
    provenance = models.JSONField(
        default=dict, help_text="device, driver, date, software, command behind the figures"
    )
    created_at = models.DateTimeField(auto_now_add=True)
    published_at = models.DateTimeField(null=True, blank=True)
    retired_at = models.DateTimeField(null=True, blank=True)

    objects = FrontVersionQuerySet.as_manager()

    class Meta:
        ordering = ["-published_at", "-id"]
        constraints = [
            models.UniqueConstraint(fields=["application", "version"], name="front_application_version"),
            models.CheckConstraint(
                condition=models.Q(state="draft") | models.Q(published_at__isnull=False),
                name="front_published_has_a_date",
            ),
        ]

    def __str__(self) -> str:
        return self.slug

    def save(self, *args: Any, **kwargs: Any) -> None:
        """Store; raises FrozenFrontError where a published row would change or become a draft again."""
        if self.pk and self.frozen:
            stored = FrontVersion.objects.get(pk=self.pk)
            changed = {
                field.attname
                for field in self._meta.concrete_fields
                if getattr(self, field.attname) != getattr(stored, field.attname)
            }
            if not changed <= MUTABLE or self.state == self.State.DRAFT:
                raise FrozenFrontError(self.slug)
        super().save(*args, **kwargs)

    def delete(self, *args: Any, **kwargs: Any) -> tuple[int, dict[str, int]]:
        """Delete a draft; raises FrozenFrontError for anything published."""
        if self.frozen:
            raise FrozenFrontError(self.slug)
        return super().delete(*args, **kwargs)

    @property
    def frozen(self) -> bool:
        """Whether the row in the database is published or retired."""
        stored = FrontVersion.objects.filter(pk=self.pk).values_list("state", flat=True).first()
        return stored is not None and stored != self.State.DRAFT


class ConfigurationQuerySet(models.QuerySet["Configuration"]):
    """Holds the configurations of published fronts fixed against bulk statements too."""

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


class Configuration(models.Model):
    """One point of a front: its name, its parameters, and what the reference device predicts of it."""

    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="configurations")
    name = models.CharField(max_length=64, validators=[NAME])
    position = models.PositiveSmallIntegerField(help_text="place in the published list, from 0")
    parameters = models.JSONField()
    predicted = models.JSONField(help_text="runtime (s), ate_max (m), ate_mean (m) on the reference device")

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
        """Store; raises FrozenFrontError once the front is published."""
        self.refuse_frozen()
        super().save(*args, **kwargs)

    def delete(self, *args: Any, **kwargs: Any) -> tuple[int, dict[str, int]]:
        """Delete from a draft; raises FrozenFrontError once the front is published."""
        self.refuse_frozen()
        return super().delete(*args, **kwargs)

    def refuse_frozen(self) -> None:
        """Raise FrozenFrontError where this row's front is published."""
        front = FrontVersion.objects.filter(pk=self.front_id).exclude(state=FrontVersion.State.DRAFT).first()
        if front is not None:
            raise FrozenFrontError(front.slug)
