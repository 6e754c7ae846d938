"""Who measures: an anonymous installation, its device as it described itself, the model derived from that."""

import uuid

from django.db import models


class Installation(models.Model):
    """One installed client. Of its token only the digest is kept; of its address nothing."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    next_token_sha256 = models.CharField(
        max_length=64,
        unique=True,
        null=True,
        editable=False,
        help_text="of a token given out and not used yet; with its first use it takes the place of the other",
    )
    app = models.CharField(max_length=64)
    app_version = models.CharField(max_length=32)
    consent_version = models.PositiveSmallIntegerField()
    created_at = models.DateTimeField(auto_now_add=True)
    revoked_at = models.DateTimeField(null=True, blank=True)
    simulated = models.BooleanField(
        default=False, editable=False, help_text="made up, measured by nobody: never part of the open data"
    )

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return f"{self.app} {str(self.id)[:8]}"


class DeviceModel(models.Model):
    """What people call the device, derived from its raw strings: the key of every published figure."""

    key = models.CharField(
        max_length=200, unique=True, editable=False, help_text="maker and name, as compared"
    )
    slug = models.SlugField(max_length=120, unique=True)
    manufacturer = models.CharField(max_length=100, blank=True)
    name = models.CharField(max_length=150)
    cpu = models.CharField(max_length=150, blank=True)
    soc = models.CharField(max_length=100, blank=True)
    gpu = models.CharField(max_length=150, blank=True)
    os = models.CharField(max_length=50, blank=True, help_text="family: Android, Linux, macOS, Windows")
    created_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["slug"]

    def __str__(self) -> str:
        return f"{self.manufacturer} {self.name}".strip()


class DeviceDescription(models.Model):
    """Raw strings exactly as sent, once per distinct content, so that a better rule can be run over them."""

    digest = models.CharField(max_length=64, unique=True, editable=False)
    raw = models.JSONField()
    model = models.ForeignKey(DeviceModel, on_delete=models.PROTECT, related_name="descriptions")
    first_seen_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["-first_seen_at"]

    def __str__(self) -> str:
        return f"{self.model} {self.digest[:8]}"
