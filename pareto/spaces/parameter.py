"""One parameter of a space: a name and the finite, ordered values it may take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pareto.errors import ConfigurationError, SpaceError
from pareto.numbers import is_finite, is_number
from pareto.spaces.user_prior import Normal, UserPrior, read_user_prior, written_user_prior
from pareto.spaces.value_ranges import MOST_VALUES, Levels, spaced

TYPES = ("ordinal", "categorical", "boolean", "integer", "real")
Value = bool | int | float | str


@dataclass(frozen=True)
class Parameter:
    """A named choice between finitely many values.

    `type` is one of TYPES. Only `categorical` values have no order; the values of all other types are
    kept in the order given, which must be ascending for numbers. A real that may take any value has Levels:
    each number stands for the nearest of them. The parameter is active only while its `condition` on other
    parameters holds, as `Conditions` reads it; without one, always. `prior` says where the user expects good
    values.
    """

    name: str
    type: str
    values: Sequence[Value]
    default: Value
    condition: str | None = None
    prior: UserPrior | None = None

    def __post_init__(self) -> None:
        if not self.name or not isinstance(self.name, str):
            raise SpaceError(f"a parameter needs a name, not {self.name!r}")
        if self.type not in TYPES:
            raise SpaceError(f"parameter {self.name!r}: type {self.type!r} is not one of {', '.join(TYPES)}")
        if not self.values:
            raise SpaceError(f"parameter {self.name!r} has no values: give at least one")
        if self.condition is not None and not isinstance(self.condition, str):
            raise SpaceError(
                f"parameter {self.name!r}: a condition is a text such as \"mode == 'fast'\", "
                f"not {self.condition!r}"
            )
        self._require_writable_texts()
        if not self.levels:
            self._require_values_of_type()
            if self.type != "categorical":
                self._require_order()
            if len(self._codes) != len(self.values):
                raise SpaceError(f"parameter {self.name!r}: values {self.some_values()} contain a duplicate")
            self._require_distinct_texts()
        try:
            code = self.encode(self.default)
        except ConfigurationError as error:
            raise SpaceError(f"default of {error}") from None
        if self.levels:
            object.__setattr__(self, "default", self.levels[code])
        self._require_fitting_prior()

    @property
    def levels(self) -> Levels | None:
        """The levels of a parameter that may take any value."""
        return self.values if isinstance(self.values, Levels) else None

    @property
    def ordered(self) -> bool:
        """Whether neighbouring values are similar, so that models may interpolate between them."""
        return self.type != "categorical"

    @cached_property
    def _codes(self) -> dict[tuple[str, Value], int]:
        return {} if self.levels else {key(value): code for code, value in enumerate(self.values)}

    @cached_property
    def _texts(self) -> dict[str, int]:
        exact = {} if self.levels else {str(value): code for code, value in enumerate(self.values)}
        return {text.strip(): code for text, code in exact.items()} | exact

    @property
    def contiguous(self) -> bool:
        """Whether the values are all whole numbers from the first to the last, as a range names them."""
        return self.type == "integer" and all(
            value == number for number, value in enumerate(self.values, int(self.values[0]))
        )

    def encode(self, value: object) -> int:
        """Return the position of `value`; numbers match to 1e-9, relative, and any number is near a level.

        Raises ConfigurationError when the parameter cannot take the value.
        """
        value = value.item() if hasattr(value, "item") else value  # NumPy scalars
        if self.levels:
            low, high = self.levels.minimum, self.levels.maximum
            if is_number(value) and is_finite(value) and low <= value <= high:  # type: ignore[arg-type, operator]
                return self.levels.position(value)  # type: ignore[arg-type]
        if self.type == "boolean" and isinstance(value, int) and value in (0, 1):
            value = bool(value)
        if isinstance(value, (bool, int, float, str)):
            code = self._codes.get(key(value))
            if code is not None:
                return code
            if isinstance(value, float) and not self.levels:
                for code, mine in enumerate(self.values):
                    if not isinstance(mine, (str, bool)) and math.isclose(mine, value, rel_tol=1e-9):
                        return code
        raise ConfigurationError(f"parameter {self.name!r}: {value!r} is not one of {self.some_values()}")

    def parse(self, text: str) -> Value:
        """Return the value of `text` (a CSV cell, a command line).

        An exact match comes first; otherwise surrounding blanks, the case of true and false and the notation
        of numbers do not matter. Raises ConfigurationError when no value is like that.
        """
        return self.values[self.position(text)]

    def position(self, text: str) -> int:
        """Return the position of the value of `text`; else as `parse`."""
        code = self._texts.get(text, self._texts.get(text.strip()))
        if code is not None:
            return code
        text = text.strip()
        truth = self._codes.get(key(text.lower() == "true")) if text.lower() in ("true", "false") else None
        if truth is not None:
            return truth
        try:
            number = float(text)
        except ValueError:
            return self.encode(text)
        return self.encode(int(number) if number.is_integer() else number)

    def to_dict(self) -> dict[str, Any]:
        """Return the plain-JSON description that `from_dict` reads."""
        described: dict[str, Any] = {"name": self.name, "type": self.type}
        if self.levels:
            described |= {"minimum": self.levels.minimum, "maximum": self.levels.maximum}
            described |= {"scale": "log"} if self.levels.scale == "log" else {}
        else:
            described["values"] = list(self.values)
        described["default"] = self.default
        if self.condition is not None:
            described["condition"] = self.condition
        if self.prior is not None:
            described["prior"] = written_user_prior(self.prior)
        return described

    @classmethod
    def from_dict(cls, description: Mapping[str, Any]) -> Parameter:
        """Read one parameter; the default value is the first one where none is given.

        `values` lists the values. Booleans need none. Integers and reals may have `minimum` and `maximum`
        instead, with a `step` (1 for integers), or with a `count` of values that are evenly spaced on a
        `scale`, "linear" or "log"; those of integers are rounded, and equal ones are one value. A real
        without both takes any value. `condition` is a text, and `prior` what `read_user_prior` reads.

        Raises SpaceError for a field that is unknown or does not go with the type, and for bad values.
        """
        name, kind = description.get("name", ""), description.get("type", "")
        if unknown := set(description) - _FIELDS:
            raise SpaceError(
                f"parameter {name!r}: unknown field {sorted(map(str, unknown))[0]!r}; "
                f"known are {', '.join(sorted(_FIELDS))}"
            )
        if given := sorted(_RANGE & set(description)):
            if kind not in ("integer", "real"):
                raise SpaceError(f"parameter {name!r}: {given[0]} is for integers and reals, not {kind!r}")
            if "values" in description:
                raise SpaceError(f"parameter {name!r}: give values or {given[0]}, not both")
        values = description.get("values")
        if "values" not in description and kind == "boolean":
            values = (False, True)
        elif "values" not in description and kind in ("integer", "real"):
            values = spaced(description)
        elif not isinstance(values, (list, tuple)):
            raise SpaceError(f"parameter {name!r}: values must be a list, not {values!r}")
        values = values if isinstance(values, Levels) else tuple(values)
        if not isinstance(values, Levels) and (
            bad := [value for value in values if not isinstance(value, (bool, int, float, str))]
        ):
            raise SpaceError(f"parameter {name!r}: {bad[0]!r} is neither a number, a text nor true or false")
        default = description.get("default", values[0] if values else None)
        if "condition" in description and description["condition"] is None:
            raise SpaceError(f"parameter {name!r}: leave the condition out where there is none")
        condition = description.get("condition")
        prior = read_user_prior(name, description["prior"]) if "prior" in description else None
        return cls(name, kind, values, default, condition, prior)

    def _require_values_of_type(self) -> None:
        if len(self.values) > MOST_VALUES:
            raise SpaceError(
                f"parameter {self.name!r} has {len(self.values):,} values: at most {MOST_VALUES:,}, "
                "use a larger step"
            )
        numbers = [value for value in self.values if isinstance(value, (int, float)) and is_number(value)]
        if bad := [number for number in numbers if not is_finite(number)]:
            raise SpaceError(f"parameter {self.name!r}: values must be finite, not {bad[0]!r:.40}")
        if self.type in ("integer", "real") and len(numbers) != len(self.values):
            raise SpaceError(
                f"parameter {self.name!r}: {self.type} values must be numbers: {self.some_values()}"
            )
        if self.type == "integer" and (bad := [number for number in numbers if number != int(number)]):
            raise SpaceError(f"parameter {self.name!r}: {bad[0]!r} is not a whole number")
        if self.type == "boolean" and not all(isinstance(value, bool) for value in self.values):
            raise SpaceError(f"parameter {self.name!r}: a boolean is true or false, not {list(self.values)}")

    def _require_fitting_prior(self) -> None:
        if isinstance(self.prior, tuple) and (self.levels or len(self.prior) != len(self.values)):
            count = "no listed" if self.levels else len(self.values)
            raise SpaceError(
                f"parameter {self.name!r}: its prior has {len(self.prior)} weights for {count} values"
            )
        if isinstance(self.prior, str) and not self.ordered:
            raise SpaceError(
                f"parameter {self.name!r}: prior {self.prior!r} needs ordered values: give a list of weights"
            )
        if isinstance(self.prior, Normal) and not all(map(is_number, self.values[:])):
            raise SpaceError(f"parameter {self.name!r}: a prior with a mean needs values that are numbers")

    def _require_order(self) -> None:
        comparable = not any(isinstance(value, str) for value in self.values)
        if comparable and list(self.values) != sorted(self.values):
            raise SpaceError(f"parameter {self.name!r}: give the values in ascending order")

    def _require_writable_texts(self) -> None:
        texts = () if self.levels else (value for value in self.values if isinstance(value, str))
        for text in (self.name, *texts):
            if text.encode(errors="ignore").decode() != text:
                raise SpaceError(
                    f"parameter {self.name!r}: {text!r} holds half of a character, "
                    "which no file in UTF-8 can keep"
                )

    def _require_distinct_texts(self) -> None:
        # A CSV file holds only text: values that are written alike cannot be distinguished when read back.
        if not any(isinstance(value, str) for value in self.values):
            return
        seen: dict[str, Value] = {}
        for value in self.values:
            text = str(value).strip()
            text = text.lower() if text.lower() in ("true", "false") else text
            if text in seen:
                raise SpaceError(
                    f"parameter {self.name!r}: {seen[text]!r} and {value!r} are written alike in a CSV file: "
                    "give texts that differ in more than blanks and quotes"
                )
            seen[text] = value

    def some_values(self) -> str:
        """Return the values as a message shows them: all, or the first and the last of many."""
        if self.levels:
            return f"the numbers {self.levels.minimum} .. {self.levels.maximum}"
        if len(self.values) <= 12:
            return str(list(self.values))
        return f"{str(list(self.values[:5]))[:-1]}, ..., {self.values[-1]!r}] ({len(self.values):,} values)"


def key(value: Value) -> tuple[str, Value]:
    """Return a key that is equal for equal values: 1 and True differ, as 1 and "1" do."""
    kind = "boolean" if isinstance(value, bool) else "text" if isinstance(value, str) else "number"
    return kind, value


_RANGE = {"minimum", "maximum", "step", "count", "scale"}
_FIELDS = {"name", "type", "values", "default", "condition", "prior"} | _RANGE
