"""Forms of the administration: a new exploration, with choices instead of JSON, and a reference device."""

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from django import forms
from django.core.exceptions import ValidationError

from crowd.explorations import services, space_choice
from crowd.explorations.measuring import reference_devices
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.objectives import ERROR_RATIO, MEASURED, RATIO
from crowd.fronts import sequences
from pareto import Space
from slam.definitions import SYSTEMS
from wire.protocol import VALID_BELOW

UPLOADED = "uploaded"  # the choice for a space that was uploaded with an earlier request
DEFAULTS = {"budget": 60, "batch": 8, "points": 8, "repeats": 3}  # a front within an hour
LIMIT_FIELDS = {  # objectives with their own limit field, and its unit
    "ate_max": ("max_error_cm", 0.01),
    "runtime": ("max_runtime_ms", 0.001),
    RATIO: ("max_runtime_ratio", 1.0),
}
OBJECTIVE_LABELS = {
    "runtime": "runtime: mean seconds a frame",
    "runtime_p95": "runtime_p95: 95 of 100 frames take no longer",
    "runtime_max": "runtime_max: seconds of the slowest frame",
    RATIO: f"{RATIO}: runtime over the default's in the same round, 0.5 is twice as fast",
    "ate_max": "ate_max: largest trajectory error",
    ERROR_RATIO: f"{ERROR_RATIO}: ate_max over the default's in the same round, on the worst sequence",
    "ate_mean": "ate_mean: mean trajectory error",
    "ate_rmse": "ate_rmse: root mean square trajectory error",
    "ate_rmse_aligned": "ate_rmse_aligned: the same after alignment",
    "cpu_seconds": "cpu_seconds: processor time a frame, all threads",
    "peak_memory_bytes": "peak_memory_bytes: most memory in use",
}
TOO_SMALL_OR_LARGE = {
    "min_value": "%(show_value)s is too small: give %(limit_value)s or more",
    "max_value": "%(show_value)s is too large: give %(limit_value)s or less",
}
T = TypeVar("T")


class ExplorationForm(forms.ModelForm):  # type: ignore[type-arg]  # not generic at run time
    """A new exploration, validated before it is stored."""

    design_space = forms.ChoiceField(label="Space", help_text="parameters and their values")
    space_file = forms.FileField(
        label="Space from a file",
        required=False,
        help_text="instead of the space above: JSON such as pareto/spaces/kfusion.json",
    )
    space_uploaded = forms.CharField(required=False, widget=forms.HiddenInput)
    system = forms.ChoiceField(
        required=False,
        choices=[("", "as the space says"), *((name, name) for name in SYSTEMS)],
        help_text="the SLAM system to run; needed for a file whose space is not named after one",
    )
    pack = forms.ChoiceField(
        label="Sequence", help_text="each configuration is measured on it; clients measure on it, too"
    )
    further_packs = forms.MultipleChoiceField(
        label="Further sequences",
        required=False,
        widget=forms.CheckboxSelectMultiple,
        help_text="each configuration is measured on these, too, and its error is the worst of all. A "
        "measurement ends early once that is certain to break the limit",
    )
    held_out_packs = forms.MultipleChoiceField(
        label="Held-out sequences",
        required=False,
        widget=forms.CheckboxSelectMultiple,
        help_text="the search does not use these; its points are checked on them at the end",
    )
    minimised = forms.MultipleChoiceField(
        label="Objectives",
        choices=[(name, OBJECTIVE_LABELS.get(name, name)) for name in MEASURED],
        widget=forms.CheckboxSelectMultiple,
        initial=["ate_max", RATIO],
    )
    max_error_cm = forms.FloatField(
        label="Largest error (cm)",
        required=False,
        min_value=0,
        initial=100 * VALID_BELOW,
        help_text="of ate_max; the search looks below it. Empty: no limit",
    )
    max_runtime_ms = forms.FloatField(
        label="Largest runtime (ms a frame)", required=False, min_value=0, help_text="Empty: no limit"
    )
    max_runtime_ratio = forms.FloatField(
        label="Largest runtime ratio",
        required=False,
        min_value=0,
        help_text="of the default's runtime: 0.5 keeps what is at least twice as fast. Empty: no limit",
    )
    random_first = forms.IntegerField(
        label="Random samples first",
        required=False,
        min_value=1,
        help_text="before the search learns. Empty: the default of the method",
    )

    more_limits = forms.CharField(
        label="Further limits",
        required=False,
        help_text="of other objectives, in metres, seconds, bytes: ate_mean=0.02, cpu_seconds=0.1",
    )
    more_options = forms.CharField(
        label="Further options", required=False, help_text="of the method: name=number, name=number"
    )

    class Meta:
        model = Exploration
        fields = (
            *("reference_device", "method", "seed", "frames", "synchronous", "recheck", "budget", "batch"),
            *("points", "repeats", "warm_start_from", "error_quantile"),
        )
        help_texts = {
            "error_quantile": "which of the errors on the sequences counts: 1 is the worst, 0.8 ignores the "
            "worst one of five",
            "budget": "configurations to search; the known ones of the application are measured in addition",
            "batch": "evaluations per batch",
            "points": "of the front that are measured again at the end",
            "repeats": "how often each of them, in turn and over the whole sequence",
        }

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._offer_spaces()
        here = [
            (_pack_choice(pack), f"{pack['name']}: {pack['frames']} frames") for pack in available_packs()
        ]
        for name in ("pack", "further_packs", "held_out_packs"):
            self.fields[name].choices = here  # type: ignore[attr-defined]
        for name, value in DEFAULTS.items():
            self.fields[name].initial = value
        self.fields["design_space"].initial = "kfusion"  # it works with every pack
        # The first is usually the server itself.
        self.fields["reference_device"].initial = (
            ReferenceDevice.objects.filter(elsewhere="").order_by("pk").first()
        )
        self.fields["warm_start_from"].required = False
        for field in self.fields.values():
            field.error_messages |= TOO_SMALL_OR_LARGE

    @property
    def space(self) -> Space:
        """The space of a valid form."""
        return Space.from_dict(self.instance.space)

    def clean_more_limits(self) -> dict[str, float]:
        """Upper bounds by objective."""
        return _numbers(self.cleaned_data["more_limits"], _bound)

    def clean_more_options(self) -> dict[str, int]:
        """Options by name."""
        return _numbers(self.cleaned_data["more_options"], int)

    def clean(self) -> dict[str, Any] | None:
        """Fill in the exploration from the choices."""
        cleaned = super().clean()
        if cleaned is None or self.errors:
            return cleaned
        wanted = self.instance
        try:
            wanted.application, wanted.space = self._system_and_space(cleaned)
        except ValidationError as error:
            self.add_error("design_space" if cleaned["space_file"] is None else "space_file", error)
            return cleaned
        first = _pack_of(cleaned["pack"])
        wanted.sequence, wanted.sequence_sha256 = first["name"], first["sha256"]
        wanted.further_sequences = [_pack_of(choice) for choice in cleaned["further_packs"]]
        wanted.held_out_sequences = [_pack_of(choice) for choice in cleaned["held_out_packs"]]
        wanted.objectives = cleaned["minimised"]
        for name in ("runtime", RATIO):
            field = LIMIT_FIELDS[name][0]
            if cleaned[field] is not None and name not in wanted.objectives:
                self.add_error(
                    field, f"a limit on {name} needs that objective: choose it, or leave this empty"
                )
        wanted.limits = cleaned["more_limits"] | {
            name: round(cleaned[field] * unit, 9)
            for name, (field, unit) in LIMIT_FIELDS.items()
            if cleaned[field] is not None and name in wanted.objectives
        }
        initial = {"initial": cleaned["random_first"]} if cleaned["random_first"] else {}
        wanted.options = cleaned["more_options"] | initial
        return cleaned

    def _system_and_space(self, cleaned: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """The chosen system and space; a new file wins. Raises ValidationError if they do not fit."""
        file, choice = cleaned["space_file"], cleaned["design_space"]
        if file is None and choice != UPLOADED:
            system, space = space_choice.space_of_choice(choice)
            system = cleaned["system"] or system
        else:
            content = cleaned["space_uploaded"].encode()
            if file is not None:
                content = file.read(space_choice.LARGEST_FILE_BYTES + 1)
            parsed = space_choice.read_space(content, "the uploaded space" if file is None else file.name)
            system, space = space_choice.system_for(parsed, cleaned["system"]), parsed.to_dict()
            self._keep(parsed)
        space_choice.check_fits(system, space)
        return system, space

    def _keep(self, space: Space) -> None:
        """Keep the uploaded `space` as a choice when the form is shown again: browsers forget files."""
        kept: Any = self.data.copy()  # type: ignore[attr-defined]
        kept.setlist("design_space", [UPLOADED])
        kept.setlist("space_uploaded", [json.dumps(space.to_dict())])
        self.data = kept
        self._offer_spaces()

    def _offer_spaces(self) -> None:
        choices = list(space_choice.space_choices())
        if self.data.get("space_uploaded"):
            choices.append((UPLOADED, "from the file"))
        self.fields["design_space"].choices = choices  # type: ignore[attr-defined]

    def _post_clean(self) -> None:
        super()._post_clean()  # type: ignore[misc]
        if not self.errors:
            try:
                services.validate(self.instance)
            except ValidationError as error:
                # Its fields are the model's, some of which have other names in this form.
                self.add_error(None, error.messages)


class ReferenceDeviceForm(forms.ModelForm):  # type: ignore[type-arg]  # not generic at run time
    """A reference device, whose hardware cannot change during an exploration."""

    class Meta:
        model = ReferenceDevice
        fields = ("name", "queue", "backend", "opencl_device", "machines")

    def clean(self) -> dict[str, Any]:
        """Refuses a change of backend or device during an exploration."""
        values: dict[str, Any] = super().clean() or self.cleaned_data
        if "backend" in values and "opencl_device" in values:
            reference_devices.check_change(self.instance, values["backend"], values["opencl_device"])
        return values


def initial_values(exploration: Exploration) -> dict[str, Any]:
    """The initial values of the form to create an exploration like `exploration`."""
    limits = exploration.limits
    kept = {name: getattr(exploration, name) for name in ExplorationForm.Meta.fields}
    if exploration.reference_device.elsewhere:
        del kept["reference_device"]
    return kept | {
        "design_space": space_choice.choice_of(exploration),
        "pack": _pack_choice(exploration.learned_on[0]),
        "further_packs": [_pack_choice(pack) for pack in exploration.further_sequences],
        "held_out_packs": [_pack_choice(pack) for pack in exploration.held_out_sequences],
        "minimised": exploration.objectives,
        "max_error_cm": round(100 * limits["ate_max"], 9) if "ate_max" in limits else None,
        "max_runtime_ms": round(1000 * limits["runtime"], 9) if "runtime" in limits else None,
        "max_runtime_ratio": limits.get(RATIO),
        "random_first": exploration.options.get("initial"),
        "more_limits": _join_numbers({name: limits[name] for name in limits if name not in LIMIT_FIELDS}),
        "more_options": _join_numbers(
            {name: value for name, value in exploration.options.items() if name != "initial"}
        ),
    }


def available_packs() -> list[dict[str, Any]]:
    """The descriptions of the packs on this machine, each once."""
    packs: dict[tuple[str, str], dict[str, Any]] = {}
    for pack in sequences.packs():
        description = sequences.read_description(pack)
        packs.setdefault((description["name"], description["sha256"]), description)
    return list(packs.values())


def _pack_choice(pack: Mapping[str, Any]) -> str:
    return f"{pack['name']} {pack['sha256']}"


def _pack_of(choice: str) -> dict[str, str]:
    name, _, sha256 = choice.rpartition(" ")
    return {"name": name, "sha256": sha256}


def _numbers(text: str, number: Callable[[str], T]) -> dict[str, T]:
    """Parse `text` such as `ate_mean=0.02, cpu_seconds=0.1`. Raises ValidationError."""
    numbers: dict[str, T] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = part.partition("=")
        try:
            numbers[name.strip()] = number(value.strip())
        except ValueError:
            raise ValidationError(f"{part}: give NAME=NUMBER, separated by commas") from None
    return numbers


def _bound(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _join_numbers(numbers: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in numbers.items())
