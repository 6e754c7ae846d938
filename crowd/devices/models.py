"""Installations, the descriptions of their devices, and the models derived from the descriptions."""

import secrets
import uuid

from django.db import models

from crowd.devices.naming import identity, names


class Installation(models.Model):
    """A client on one device, anonymous: only a digest of its token and a keyed hash of its network are
    stored.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    token_sha256 = models.CharField(max_length=64, unique=True, editable=False)
    next_token_sha256 = models.CharField(  # noqa: DJ001 - unique: a missing token is NULL
        max_length=64,
        unique=True,
        null=True,
        editable=False,
        help_text="of a token given out and not used yet; with its first use it takes the place of the other",
    )
    app = models.CharField(max_length=64)
    app_version = models.CharField(max_length=32)
    consent_version = models.PositiveSmallIntegerField()
    show_model = models.BooleanField(
        default=False, help_text="the participant agreed that the model is named, however rare it is"
    )
    created_at = models.DateTimeField(auto_now_add=True)
    revoked_at = models.DateTimeField(null=True, blank=True)
    description = models.ForeignKey(
        "DeviceDescription",
        on_delete=models.SET_NULL,
        null=True,
        editable=False,
        related_name="+",
        help_text="how its device described itself first; an installation is one device",
    )
    network = models.CharField(
        max_length=32,
        blank=True,
        db_index=True,
        editable=False,
        help_text="keyed hash of the network (/24, /48) that it enrolled from; empty: not known",
    )

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return f"{self.app} {str(self.id)[:8]}"


def new_mask() -> str:
    """A random suffix for the address of a masked model."""
    return secrets.token_hex(5)


class DeviceModel(models.Model):
    """A device model, derived from raw strings.

    Sessions and figures are stored under it. An alias is shown as its `canonical` model, and its sessions are
    stored there. `crowd.devices.disclosure` defines what the public sees.
    """

    class Kind(models.TextChoices):
        DEVICE = identity.DEVICE
        UNKNOWN = identity.UNKNOWN_DEVICE, "unknown device"
        EMULATOR = identity.EMULATOR
        VIRTUAL = identity.VIRTUAL, "virtual machine"

    key = models.CharField(
        max_length=200, unique=True, editable=False, help_text="maker and name, as compared"
    )
    slug = models.SlugField(max_length=120, unique=True)
    manufacturer = models.CharField(max_length=100, blank=True)
    name = models.CharField(max_length=150)
    market_name = models.CharField(
        max_length=150, blank=True, help_text="what it is sold as, from the imported catalogue"
    )
    cpu = models.CharField(max_length=150, blank=True)
    soc = models.CharField(max_length=100, blank=True)
    gpu = models.CharField(max_length=150, blank=True)
    os = models.CharField(max_length=50, blank=True, help_text="family: Android, Linux, macOS, Windows")
    kind = models.CharField(max_length=10, choices=Kind.choices, default=Kind.DEVICE)
    judged_by = models.CharField(
        max_length=150, blank=True, help_text="who set the kind by hand; empty: the rules did"
    )
    judged_at = models.DateTimeField(null=True, blank=True)
    named = models.BooleanField(
        default=False, help_text="a rule, the catalogue or an administrator knows the name"
    )
    rare = models.BooleanField(default=True, help_text="measured by too few installations to be named")
    consented = models.BooleanField(
        default=False, help_text="everybody who measured it agreed that it is named, however rare it is"
    )
    mask = models.CharField(
        max_length=12, unique=True, default=new_mask, editable=False, help_text="the end of a masked address"
    )
    published_slug = models.CharField(
        max_length=120, blank=True, editable=False, help_text="the address in the open data written so far"
    )
    canonical = models.ForeignKey(
        "self",
        on_delete=models.PROTECT,
        null=True,
        blank=True,
        related_name="members",
        help_text="the model that this one is an alias of",
    )
    changed = models.BooleanField(
        default=True,
        editable=False,
        help_text="its descriptions or kind changed: sessions have to follow",
    )
    examined = models.BooleanField(default=False, editable=False, help_text="aliases were looked for")
    created_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["slug"]
        indexes = [
            models.Index(fields=["id"], name="device_changed", condition=models.Q(changed=True)),
            models.Index(fields=["id"], name="device_unexamined", condition=models.Q(examined=False)),
        ]

    def __str__(self) -> str:
        return f"{self.manufacturer} {self.display_name}".strip()

    @property
    def display_name(self) -> str:
        """The market name with the code in parentheses, or the name."""
        return names.display_name(self.manufacturer, self.name, self.market_name)

    @property
    def canonical_or_self(self) -> "DeviceModel":
        """The model that this one is an alias of, or itself."""
        return self.canonical or self


class ProcessorClass(models.TextChoices):
    """The kind of chip that computed. Times of the two kinds are never averaged."""

    CPU = "cpu"
    GPU = "gpu"


class DeviceDescription(models.Model):
    """Raw strings exactly as sent, stored once per distinct content, so that new rules can be applied."""

    digest = models.CharField(max_length=64, unique=True, editable=False)
    raw = models.JSONField()
    model = models.ForeignKey(DeviceModel, on_delete=models.PROTECT, related_name="descriptions")
    driver_name = models.CharField(max_length=50, blank=True)
    driver_version = models.CharField(max_length=50, blank=True)
    processor = models.CharField(
        max_length=200, blank=True, help_text="the chip that computed, as the rules call it"
    )
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices, default="gpu")
    rules = models.PositiveSmallIntegerField(
        default=0, editable=False, help_text="version of the rules that derived the model"
    )
    split = models.ForeignKey(
        "DeviceSplit",
        on_delete=models.PROTECT,
        null=True,
        blank=True,
        related_name="descriptions",
        help_text="the decision that took it out of the model that the rules would choose",
    )
    first_seen_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["-first_seen_at"]
        indexes = [models.Index(fields=["rules", "id"], name="description_rules")]

    def __str__(self) -> str:
        return f"{self.model} {self.digest[:8]}"

    @property
    def driver(self) -> str:
        """The name and version of the OpenCL driver, or of the browser."""
        return f"{self.driver_name} {self.driver_version}".strip()


class DeviceAlias(models.Model):
    """Two names of one model: proposed by a rule or made by an administrator, who also decides and undoes.

    An undone decision stays stored, with who undid it and when.
    """

    class State(models.TextChoices):
        PROPOSED = "proposed"
        ACCEPTED = "accepted"
        REFUSED = "refused"
        UNDONE = "undone"

    alias = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="aliases")
    model = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="alias_of")
    reason = models.CharField(max_length=100)
    state = models.CharField(max_length=10, choices=State.choices, default=State.PROPOSED)
    proposed_at = models.DateTimeField(auto_now_add=True)
    decided_at = models.DateTimeField(null=True, blank=True)
    decided_by = models.CharField(max_length=150, blank=True)
    undone_at = models.DateTimeField(null=True, blank=True)
    undone_by = models.CharField(max_length=150, blank=True)

    class Meta:
        verbose_name_plural = "device aliases"
        ordering = ["-id"]
        constraints = [
            models.UniqueConstraint(
                fields=["alias"], condition=models.Q(state="accepted"), name="one_model_of_an_alias"
            ),
            models.UniqueConstraint(
                fields=["alias", "model"],
                condition=models.Q(state__in=["proposed", "refused"]),
                name="one_proposal_of_a_pair",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.alias} = {self.model}"


class DeviceSplit(models.Model):
    """A decision to move descriptions out of the model that the rules chose."""

    source = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="splits")
    model = models.OneToOneField(DeviceModel, on_delete=models.CASCADE, related_name="split_from")
    decided_at = models.DateTimeField(auto_now_add=True)
    decided_by = models.CharField(max_length=150)
    undone_at = models.DateTimeField(null=True, blank=True)
    undone_by = models.CharField(max_length=150, blank=True)

    class Meta:
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"{self.model} out of {self.source}"


class CatalogueEntry(models.Model):
    """A line of an imported catalogue: the market name and the chips behind a maker's code."""

    maker = models.CharField(max_length=100, blank=True, help_text="as compared; empty: the list names none")
    device = models.CharField(max_length=100, blank=True, db_index=True, help_text="Android's Build.DEVICE")
    code = models.CharField(max_length=100, blank=True, db_index=True, help_text="Android's Build.MODEL")
    market_name = models.CharField(max_length=150)
    soc = models.CharField(max_length=100, blank=True)
    gpu = models.CharField(max_length=150, blank=True)

    class Meta:
        verbose_name_plural = "catalogue entries"
        ordering = ["maker", "market_name"]
        constraints = [
            models.UniqueConstraint(fields=["maker", "device", "code"], name="catalogue_key"),
        ]

    def __str__(self) -> str:
        return f"{self.market_name} ({self.code or self.device})"


class AttemptCount(models.Model):
    """How often browsers took a step of measuring on one day; see `crowd.devices.attempts`.

    Only listed words are stored, nothing about visitors. It is never part of figures or open data.
    """

    day = models.DateField(help_text="UTC")
    step = models.CharField(max_length=12, help_text="opened, unsupported, began, failed or finished")
    reason = models.CharField(max_length=16, blank=True, help_text="why it went no further")
    gpu_vendor = models.CharField(max_length=16, blank=True)
    gpu_architecture = models.CharField(max_length=16, blank=True)
    browser = models.CharField(max_length=24, blank=True)
    count = models.PositiveIntegerField()

    class Meta:
        verbose_name = "browser attempt"
        ordering = ["-day", "step", "-count"]
        constraints = [
            models.UniqueConstraint(
                fields=["day", "step", "reason", "gpu_vendor", "gpu_architecture", "browser"],
                name="attempt_count_key",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.day} {self.step} {self.reason}".strip()


class Revision(models.Model):
    """A change of what pages show; see `crowd.devices.revision`."""

    def __str__(self) -> str:
        return str(self.pk)
