"""How OpenCL kernels are compiled and launched: the build options of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from slam.configuration import ConfigurationError, Parameters, flag, whole
from slam.devices.layout import Layout

PREFIX = "build_"  # of their names beside the parameters of a system
# With these the compiler assumes that NaN does not exist: bounds tests written `!(x >= 0 && x < width)` then
# let NaN through.
REFUSED = {
    "build_fast_relaxed_math": "-cl-fast-relaxed-math",
    "build_finite_math_only": "-cl-finite-math-only",
}
MOST_IN_GROUP = 1024  # work-items; a device that allows fewer makes groups smaller


@dataclass(frozen=True)
class Build(Parameters):
    """The build options of a run; the defaults are those that everything else of the project uses.

    build_unsafe_math: sums may be reordered, which makes vector code of them; implies the next two.
    build_mad_enable: a * b + c may be rounded once. build_no_signed_zeros: 0 and -0 are the same.
    build_group_width: work-items of a group across, one a pixel; 1: one work-item walks an image row; 0: the
    fastest of a trial. build_group_height: work-items of a group down, of groups wider than 1.
    build_threads: of the processor; 0: all.
    """

    system: ClassVar[str] = "a build"

    build_unsafe_math: bool = True
    build_mad_enable: bool = True
    build_no_signed_zeros: bool = False
    build_group_width: int = 0
    build_group_height: int = 8
    build_threads: int = 0

    def __post_init__(self) -> None:
        for name in ("build_unsafe_math", "build_mad_enable", "build_no_signed_zeros"):
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        for name, least in (("build_group_width", 0), ("build_group_height", 1), ("build_threads", 0)):
            object.__setattr__(self, name, whole(name, getattr(self, name), least))
        width, height = self.build_group_width, self.build_group_height
        if width > 1 and width * height > MOST_IN_GROUP:
            raise ConfigurationError(
                f"build_group_width={width}, build_group_height={height}: a group has at most "
                f"{MOST_IN_GROUP} work-items"
            )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """As of any parameters; options that let NaN through are refused."""
        for name, option in REFUSED.items():
            if name in values:
                raise ConfigurationError(
                    f"{name}={values[name]!r}: {option} removes the tests that keep NaN out of the map: use "
                    "build_unsafe_math, build_mad_enable or build_no_signed_zeros"
                )
        return super().from_mapping(values)

    def __str__(self) -> str:
        return " ".join(f"{name}={value:d}" for name, value in self.changed.items())

    @property
    def changed(self) -> dict[str, Any]:
        """The options that are not the default."""
        default = DEFAULT.to_dict()
        return {name: value for name, value in self.to_dict().items() if value != default[name]}

    @property
    def options(self) -> tuple[str, ...]:
        """The options of the compiler."""
        chosen = (
            (self.build_mad_enable, "-cl-mad-enable"),
            (self.build_no_signed_zeros, "-cl-no-signed-zeros"),
            (self.build_unsafe_math, "-cl-unsafe-math-optimizations"),
        )
        return ("-cl-std=CL1.2", *(option for used, option in chosen if used), "-cl-denorms-are-zero")

    @property
    def layout(self) -> Layout | None:
        """The layout of kernels over images; None where a trial chooses it."""
        if self.build_group_width == 0:
            return None
        if self.build_group_width == 1:
            return Layout("rows")
        return Layout("pixels", (self.build_group_width, self.build_group_height))


DEFAULT = Build()


def split(values: Mapping[str, Any]) -> tuple[dict[str, Any], Build]:
    """The parameters of a system among `values`, and the build that the others describe.

    Without build options that is DEFAULT; inactive ones (None) are left out. Raises ConfigurationError for a
    bad one.
    """
    own = {name for name in values if name.startswith(PREFIX)}
    build = Build.from_mapping({name: values[name] for name in own if values[name] is not None})
    return {name: value for name, value in values.items() if name not in own}, build
