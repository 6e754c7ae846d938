"""A submission, its sessions and their runs, with all series as JSON."""
# ruff: noqa: DJ008 - these rows are never displayed

from django.db import models


class Submission(models.Model):
    """One accepted request."""

    installation = models.ForeignKey("devices.Installation", on_delete=models.CASCADE, related_name="+")
    idempotency_key = models.CharField(max_length=128)
    schema_version = models.PositiveSmallIntegerField()
    app_version = models.CharField(max_length=32)
    consent_version = models.PositiveSmallIntegerField()
    device = models.JSONField()
    received_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        constraints = [models.UniqueConstraint(fields=["installation", "idempotency_key"], name="plain_key")]


class Session(models.Model):
    """Runs of several configurations, one after another."""

    id = models.UUIDField(primary_key=True)
    submission = models.ForeignKey(Submission, on_delete=models.CASCADE, related_name="sessions")
    started_at = models.DateTimeField()
    application = models.CharField(max_length=64)
    front_version = models.CharField(max_length=97)
    protocol_version = models.PositiveSmallIntegerField()
    backend = models.CharField(max_length=32)
    empty_frame_us = models.FloatField()
    stage_clock = models.CharField(max_length=8)
    samples = models.JSONField()


class Run(models.Model):
    """One configuration over the whole sequence."""

    id = models.UUIDField(primary_key=True)
    session = models.ForeignKey(Session, on_delete=models.CASCADE, related_name="runs")
    configuration = models.CharField(max_length=64)
    repeat = models.PositiveSmallIntegerField()
    order = models.PositiveSmallIntegerField()
    status = models.CharField(max_length=8, choices=[("ok", "ok"), ("failed", "failed")])
    failure = models.CharField(max_length=500, null=True)  # noqa: DJ001 - as documents have it
    frame_us = models.JSONField()
    stages_us = models.JSONField()
    tracked = models.JSONField()
    ate_max = models.FloatField(null=True)
    ate_mean = models.FloatField(null=True)
    ate_rmse = models.FloatField(null=True)
    deviation = models.FloatField(null=True)
