"""Maps of devices, recommendations, and probes that installations are asked to measure."""

from django.core.validators import MinValueValidator
from django.db import models

from crowd.devices.models import DeviceModel, Installation, ProcessorClass
from crowd.fronts.models import Configuration, FrontVersion


class DeviceMap(models.Model):
    """What the nightly rebuild learned from the devices that measured a front with one backend and class of
    processor. Derived data: it can be deleted and computed again.
    """

    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="device_maps")
    backend = models.CharField(max_length=32)
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices)
    rung = models.CharField(max_length=16, help_text="the model that predicts other families best")
    scale = models.FloatField(help_text="how many times wider intervals are than the model believes")
    errors = models.JSONField(help_text="by rung: median relative error of predicted ratios, and of how many")
    quantities = models.JSONField(help_text="names of the times, in the order of the belief")
    belief = models.BinaryField(help_text="mean, covariance and relation, an .npz file")
    devices = models.PositiveIntegerField()
    sessions = models.PositiveIntegerField()
    other_recommended = models.PositiveIntegerField(
        null=True, help_text="devices for which another configuration than the published best is recommended"
    )
    made_at = models.DateTimeField()

    class Meta:
        ordering = ["front_id", "backend", "processor_class"]
        constraints = [
            models.UniqueConstraint(fields=["front", "backend", "processor_class"], name="device_map_key"),
        ]

    def __str__(self) -> str:
        return f"{self.front.slug} {self.backend} {self.processor_class}"


class ProbeRequest(models.Model):
    """An administrator's request for sessions of a configuration, on some chips."""

    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    chip = models.CharField(
        max_length=100, blank=True, help_text="part of the chip's name, such as Mali; empty: any chip"
    )
    sessions = models.PositiveSmallIntegerField(
        default=3, validators=[MinValueValidator(1)], help_text="how many sessions to measure"
    )
    reason = models.CharField(max_length=150, help_text="shown to the people who are asked")
    active = models.BooleanField(default=True)
    created_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"{self.configuration} on {self.chip or 'any chip'}"


class ProbeAssignment(models.Model):
    """A configuration that an installation was asked to measure, and why. Never edited."""

    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="assignments")
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True)
    why = models.CharField(max_length=200)
    request = models.ForeignKey(
        ProbeRequest, on_delete=models.SET_NULL, null=True, blank=True, related_name="assignments"
    )
    seed = models.BigIntegerField(help_text="of the choice between configurations that teach nearly alike")
    gains = models.JSONField(
        default=dict,
        help_text="by how much each configuration would have lowered the variance; empty for a wish",
    )
    map_made_at = models.DateTimeField(null=True, help_text="which night's map decided; empty: none")
    assigned_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["-id"]
        indexes = [models.Index(fields=["installation", "assigned_at"], name="assignment_newest")]

    def __str__(self) -> str:
        return f"{self.configuration.name} for {str(self.installation_id)[:8]}"


class Recommendation(models.Model):
    """A recommendation for a device with its prediction at that time. Later measurements judge it."""

    device = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="recommendations")
    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="recommendations")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True)
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices)
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    rung = models.CharField(max_length=16)
    log_ratio = models.FloatField(help_text="natural logarithm of the predicted speedup")
    low = models.FloatField(help_text="95 % interval of log_ratio")
    high = models.FloatField()
    made_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["-id"]
        indexes = [models.Index(fields=["front", "device"], name="recommendation_device")]

    def __str__(self) -> str:
        return f"{self.configuration.name} for {self.device}"
