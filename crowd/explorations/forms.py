"""Forms of the administration: a new exploration in choices instead of JSON, and a reference device."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from django import forms
from django.core.exceptions import ValidationError

import pareto
from crowd.explorations import services
from crowd.explorations.measuring import reference_devices
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.objectives import ERROR_RATIO, MEASURED, RATIO
from crowd.fronts import sequences
from crowd.fronts.content.front_file import APPLICATIONS
from pareto import Space
from slam.protocol import VALID_BELOW

SPACES = Path(pareto.__file__).parent / "spaces"
EARLIER = "exploration-"  # a design space that is that of an earlier exploration
DEFAULTS = {"budget": 60, "batch": 8, "points": 8, "repeats": 3}  # a front within an hour
LIMITED = {  # objectives whose limit has a field of its own, and its unit
    "ate_max": ("max_error_cm", 0.01),
    "runtime": ("max_runtime_ms", 0.001),
    RATIO: ("max_runtime_ratio", 1.0),
}
EXPLAINED = {
    "runtime": "runtime: mean seconds a frame",
    RATIO: f"{RATIO}: runtime over the default's in the same round, 0.5 is twice as fast",
    "ate_max": "ate_max: largest trajectory error",
    ERROR_RATIO: f"{ERROR_RATIO}: ate_max over the default's in the same round, on the worst sequence",
    "ate_mean": "ate_mean: mean trajectory error",
    "ate_rmse": "ate_rmse: root mean square trajectory error",
    "ate_rmse_aligned": "ate_rmse_aligned: the same after alignment",
    "cpu_seconds": "cpu_seconds: processor time a frame, all threads",
    "peak_memory_bytes": "peak_memory_bytes: most memory in use",
}
T = TypeVar("T")


class ExplorationForm(forms.ModelForm):
    """Says what is wrong with a new exploration before it is stored."""

    design_space = forms.ChoiceField(help_text="parameters and their values; the system follows from it")
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
        help_text="the search never sees these; what it found is checked on them at the end",
    )
    minimised = forms.MultipleChoiceField(
        label="Objectives",
        choices=[(name, EXPLAINED.get(name, name)) for name in MEASURED],
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
        help_text="before the search learns. Empty: what the method holds best",
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
            "budget": "configurations to search; the application's known ones are measured besides",
            "batch": "asked for at a time",
            "points": "of the front, to be measured again at the end",
            "repeats": "how often each of them, in turn and over the whole sequence",
        }

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        earlier = Exploration.objects.order_by("-pk").values_list("pk", "application", "space")
        shown: dict[str, str] = {}
        for key, application, space in earlier:
            shown.setdefault(_identity(application, space), f"{EARLIER}{key}")
        for path in shipped_spaces():
            shown.pop(_identity(path.stem, Space.load(path).to_dict()), None)
        self.fields["design_space"].choices = [  # type: ignore[attr-defined]
            *((path.stem, path.stem) for path in shipped_spaces()),
            *((value, f"as in exploration {value.removeprefix(EARLIER)}") for value in shown.values()),
        ]
        here = [(_pack_choice(pack), f"{pack['name']}: {pack['frames']} frames") for pack in packs()]
        for name in ("pack", "further_packs", "held_out_packs"):
            self.fields[name].choices = here  # type: ignore[attr-defined]
        for name, value in DEFAULTS.items():
            self.fields[name].initial = value
        self.fields["design_space"].initial = "kfusion"  # every pack will do for it
        # The first is the server itself, unless an administrator made it otherwise.
        self.fields["reference_device"].initial = ReferenceDevice.objects.order_by("pk").first()
        self.fields["warm_start_from"].required = False

    def clean_more_limits(self) -> dict[str, float]:
        """Upper bounds by objective."""
        return _numbers(self.cleaned_data["more_limits"], _bound)

    def clean_more_options(self) -> dict[str, int]:
        """Options by name."""
        return _numbers(self.cleaned_data["more_options"], int)

    def clean(self) -> dict[str, Any] | None:
        """Put together the exploration's JSON from the choices."""
        cleaned = super().clean()
        if cleaned is None or self.errors:
            return cleaned
        wanted = self.instance
        wanted.application, wanted.space = space_of(cleaned["design_space"])
        first = _pack_of(cleaned["pack"])
        wanted.sequence, wanted.sequence_sha256 = first["name"], first["sha256"]
        wanted.further_sequences = [_pack_of(choice) for choice in cleaned["further_packs"]]
        wanted.held_out_sequences = [_pack_of(choice) for choice in cleaned["held_out_packs"]]
        wanted.objectives = cleaned["minimised"]
        for name in ("runtime", RATIO):
            field = LIMITED[name][0]
            if cleaned[field] is not None and name not in wanted.objectives:
                self.add_error(
                    field, f"a limit on {name} needs that objective: choose it, or leave this empty"
                )
        wanted.limits = cleaned["more_limits"] | {
            name: round(cleaned[field] * unit, 9)
            for name, (field, unit) in LIMITED.items()
            if cleaned[field] is not None and name in wanted.objectives
        }
        initial = {"initial": cleaned["random_first"]} if cleaned["random_first"] else {}
        wanted.options = cleaned["more_options"] | initial
        return cleaned

    def _post_clean(self) -> None:
        super()._post_clean()  # type: ignore[misc]
        if not self.errors:
            try:
                services.check(self.instance)
            except ValidationError as error:
                # Its members are the model's, some of which this form has under other names.
                self.add_error(None, error.messages)


class ReferenceDeviceForm(forms.ModelForm):
    """Keeps what an exploration counts on."""

    class Meta:
        model = ReferenceDevice
        fields = ("name", "queue", "backend", "opencl_device", "machines")

    def clean(self) -> dict[str, Any]:
        """Backend and device stay while an exploration of the reference device is not finished."""
        values: dict[str, Any] = super().clean() or self.cleaned_data
        if "backend" in values and "opencl_device" in values:
            reference_devices.check_change(self.instance, values["backend"], values["opencl_device"])
        return values


def initial_of(exploration: Exploration) -> dict[str, Any]:
    """What the form holds to create such an exploration again."""
    limits = exploration.limits
    kept = {name: getattr(exploration, name) for name in ExplorationForm.Meta.fields}
    return kept | {
        "design_space": _choice_of(exploration),
        "pack": _pack_choice(exploration.learned_on[0]),
        "further_packs": [_pack_choice(pack) for pack in exploration.further_sequences],
        "held_out_packs": [_pack_choice(pack) for pack in exploration.held_out_sequences],
        "minimised": exploration.objectives,
        "max_error_cm": round(100 * limits["ate_max"], 9) if "ate_max" in limits else None,
        "max_runtime_ms": round(1000 * limits["runtime"], 9) if "runtime" in limits else None,
        "max_runtime_ratio": limits.get(RATIO),
        "random_first": exploration.options.get("initial"),
        "more_limits": _written({name: limits[name] for name in limits if name not in LIMITED}),
        "more_options": _written(
            {name: value for name, value in exploration.options.items() if name != "initial"}
        ),
    }


def shipped_spaces() -> list[Path]:
    """The files of the spaces whose system is there to be run."""
    return [path for path in sorted(SPACES.glob("*.json")) if path.stem in APPLICATIONS]


def packs() -> list[dict[str, Any]]:
    """What the packs on this machine say of themselves; the same one is listed once."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for pack in sequences.packs():
        description = sequences.described(pack)
        found.setdefault((description["name"], description["sha256"]), description)
    return list(found.values())


def space_of(choice: str) -> tuple[str, dict[str, Any]]:
    """The application and the space that CHOICE stands for."""
    if choice.startswith(EARLIER):
        earlier = Exploration.objects.get(pk=int(choice.removeprefix(EARLIER)))
        return earlier.application, earlier.space
    return choice, Space.load(SPACES / f"{choice}.json").to_dict()


def _pack_choice(pack: Mapping[str, Any]) -> str:
    return f"{pack['name']} {pack['sha256']}"


def _pack_of(choice: str) -> dict[str, str]:
    name, _, sha256 = choice.rpartition(" ")
    return {"name": name, "sha256": sha256}


def _choice_of(exploration: Exploration) -> str:
    wanted = _identity(exploration.application, exploration.space)
    for path in shipped_spaces():
        if _identity(path.stem, Space.load(path).to_dict()) == wanted:
            return path.stem
    same = Exploration.objects.filter(application=exploration.application, space=exploration.space)
    newest = same.order_by("-pk").first()
    return f"{EARLIER}{newest.pk if newest else exploration.pk}"


def _identity(application: str, space: dict[str, Any]) -> str:
    return json.dumps([application, space], sort_keys=True)


def _numbers(text: str, number: Callable[[str], T]) -> dict[str, T]:
    """TEXT such as `ate_mean=0.02, cpu_seconds=0.1`. Raises ValidationError naming what cannot be read."""
    found: dict[str, T] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = part.partition("=")
        try:
            found[name.strip()] = number(value.strip())
        except ValueError:
            raise ValidationError(f"{part}: give NAME=NUMBER, several of them with commas between") from None
    return found


def _bound(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _written(numbers: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in numbers.items())
