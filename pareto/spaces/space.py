"""A discrete design space: the product of finitely many parameters, indexed by one integer."""

from __future__ import annotations

import hashlib
import json
import math
import operator
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import ConfigurationError, ConstraintError, ForbiddenError, SpaceError, StateError
from pareto.spaces.conditions import Conditions
from pareto.spaces.grid import Grid, Indices
from pareto.spaces.parameter import Parameter, Value
from pareto.spaces.region import Count, Region

Configuration = dict[str, Value | None]  # None: the parameter is inactive


class Space(Grid):
    """The full product of `parameters`, of which known `constraints` may allow a part only.

    Every configuration has one index in 0 .. len(space) - 1, forbidden ones too. The first parameter varies
    slowest, as in a C-ordered NumPy array of shape `space.shape`, so an array over the whole space reshapes
    to that grid. `allowed` tells which points keep all constraints. A forbidden default moves to an allowed
    point near it, if changing the `movable` parameters, those without an explicit default, is enough.

    A parameter with a condition is inactive where it does not hold, and None in configurations there. Of the
    indices that differ in inactive parameters only, one is allowed: that with their defaults (see `fold`).

    Raises SpaceError, or ConstraintError for a constraint or condition that cannot be read, for constraints
    that forbid the default, and for constraints that allow nothing.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        name: str = "space",
        constraints: Sequence[str] = (),
        movable: Collection[str] = (),
    ) -> None:
        self.name = name
        super().__init__(parameters)
        self.defaults_chosen = tuple(movable)
        self._constrain(constraints)
        self._allow_default(movable)

    def __repr__(self) -> str:
        constraints = f", {len(self.constraints)} constraints" if self.constraints else ""
        return f"<Space {self.name!r}: {len(self.parameters)} parameters, {len(self):,} points{constraints}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Space) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(self.digest)

    def __reduce__(self) -> tuple[Any, ...]:
        return Space.from_dict, (self.to_dict(),)  # constraints hold functions, which are not pickled

    @cached_property
    def default(self) -> Configuration:
        """The configuration in which every active parameter has its default value."""
        return self.decode(self.index_of({item.name: item.default for item in self.parameters}))

    def parse(self, cells: Mapping[str, str]) -> Configuration:
        """Return the configuration of texts by parameter, as in a row of a CSV file.

        The empty text is None for a parameter with a condition, unless it is one of its values. Raises
        ConfigurationError for a text that a parameter cannot take; further texts are ignored.
        """
        configuration: Configuration = {}
        for item in self.parameters:
            inactive = item.condition is not None and not cells[item.name].strip() and "" not in item.values
            configuration[item.name] = None if inactive else item.parse(cells[item.name])
        return configuration

    @cached_property
    def digest(self) -> str:
        """SHA-256 of parameters and constraints: equal spaces have the same indices and allowed points."""
        described = self.to_dict()
        del described["name"]
        text = json.dumps(described, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def encode(self, configuration: Mapping[str, object]) -> int:
        """Return the index of `configuration`; inactive parameters may have any value, None, or be absent.

        Raises ConfigurationError for anything but a mapping, a missing or unknown parameter or a bad value,
        and its subclass ForbiddenError for a broken constraint.
        """
        index = self.index_of(configuration)
        for constraint in self.constraints:
            if not self.evaluate(constraint.clauses, np.array([index]))[0]:
                values = ", ".join(f"{name} = {configuration[name]!r}" for name in constraint.names)
                raise ForbiddenError(f"{values} breaks the constraint {constraint.text!r}")
        return index

    def index_of(self, configuration: Mapping[str, object]) -> int:
        """Return the index of `configuration`, whether constraints allow it or not; else as `encode`."""
        if not isinstance(configuration, Mapping):
            raise ConfigurationError(f"a configuration maps parameters to values, {configuration!r} does not")
        for name in configuration:
            if name not in self.names:
                raise ConfigurationError(
                    f"unknown parameter {name!r}: this space has {', '.join(self.names)}"
                )
        index, missing = 0, []
        for parameter, size in zip(self.parameters, self.shape, strict=True):
            value = configuration.get(parameter.name)
            if value is None and parameter.condition is not None:
                missing.append(parameter.name)
                value = parameter.default
            elif parameter.name not in configuration:
                raise _missing(parameter.name, configuration)
            index = index * size + parameter.encode(value)
        if missing:
            active = self._active(index)
            for name in missing:
                if active[name]:
                    raise _missing(name, configuration)
        return int(self.fold(np.array([index]))[0]) if self.conditions else index

    def decode(self, index: int) -> Configuration:
        """Return the configuration of `index`, in which inactive parameters are None.

        Raises ConfigurationError outside 0 .. len - 1.
        """
        if not 0 <= index < len(self):
            raise ConfigurationError(f"index {index} is outside 0 .. {len(self) - 1}")
        active = self._active(index)
        values: list[Value] = []
        for parameter, size in zip(reversed(self.parameters), reversed(self.shape), strict=True):
            index, code = divmod(int(index), size)
            values.append(parameter.values[code])
        return {
            name: value if active.get(name, True) else None
            for name, value in zip(self.names, reversed(values), strict=True)
        }

    def allowed(self, indices: Iterable[int] | Indices) -> NDArray[np.bool_]:
        """Return a mask of the `indices` that keep all constraints: all of them where there are none.

        Where parameters are inactive, only the index with their defaults is allowed.
        """
        flat = np.asarray(indices if isinstance(indices, np.ndarray) else list(indices), dtype=np.int64)
        return self.evaluate(self.clauses, flat)

    @cached_property
    def allowed_grid(self) -> NDArray[np.bool_]:
        """`allowed` for every point in index order: len(space) bytes, read only, made once."""
        grid = np.ones(self.shape, dtype=bool)
        # An axis a parameter, as in an open grid: a constraint is evaluated on its own parameters only.
        codes = dict(zip(self.names, np.ix_(*map(np.arange, self.shape)), strict=True))
        for clause in self.clauses:
            grid &= clause.holds(codes)
        grid.flags.writeable = False
        return grid.reshape(-1)

    @cached_property
    def region(self) -> Region:
        """The allowed part, from which points are counted and drawn."""
        return Region(self)

    @cached_property
    def region_of_values(self) -> Region:
        """The allowed part, in which inactive parameters have values to draw; `region` without conditions."""
        return Region(self, folded=True) if self.conditions else self.region

    def count_allowed(self) -> Count:
        """Return the number of allowed points: exact, or with its error where it could only be estimated.

        It is exact whenever no constraint links more than about four million combinations of values.
        """
        return self.region.count

    def neighbours(self, index: int, reach: int | None = None) -> Indices:
        """Return every allowed point that differs from `index` in exactly one parameter, ascending.

        `reach` bounds the step along ordered parameters (1: the next value up and down); None means any other
        value. Unordered parameters always take every other value; those of any value take steps of 1, 2, 4
        and so on levels. Parameters that become active by the step have their defaults.
        """
        [codes] = self.codes([index])
        indices = []
        for code, parameter, size, stride in zip(
            codes, self.parameters, self.shape, self.strides, strict=True
        ):
            if parameter.levels:
                powers = 2 ** np.arange(size.bit_length())
                steps = np.concatenate([-powers, powers])
                steps = steps[(-code <= steps) & (steps < size - code)]
            else:
                steps = np.arange(size) - code
            if reach is not None and parameter.ordered:
                steps = steps[np.abs(steps) <= reach]
            indices.append(index + steps[steps != 0] * stride)
        others = self.fold(np.concatenate(indices).astype(np.int64))
        if self.conditions:
            others = np.setdiff1d(others, self.fold(np.array([index])))
        others = np.sort(others)
        return others[self.allowed(others)]

    def features(self, indices: Iterable[int] | Indices) -> NDArray[np.float64]:
        """Return (n, columns) coordinates in the unit cube, for models that measure distances.

        An ordered parameter is one column, its values evenly spaced. A categorical one has a column a value,
        1/sqrt(2) in its own, so that any two of its values are at distance 1. `feature_owner` tells whose
        column is which. Inactive parameters have the coordinates of their defaults.
        """
        flat = np.asarray(indices if isinstance(indices, np.ndarray) else list(indices), dtype=np.int64)
        codes = self.codes(self.fold(flat))
        columns = []
        for axis, (parameter, size) in enumerate(zip(self.parameters, self.shape, strict=True)):
            if parameter.ordered:
                columns.append(codes[:, axis : axis + 1] / max(size - 1, 1))
            else:
                columns.append((codes[:, axis : axis + 1] == np.arange(size)) / math.sqrt(2))
        return np.concatenate(columns, axis=1).astype(np.float64, copy=False)

    @cached_property
    def feature_owner(self) -> NDArray[np.int64]:
        """For each column of `features`, the position of the parameter it belongs to."""
        widths = [1 if parameter.ordered else len(parameter.values) for parameter in self.parameters]
        return np.repeat(np.arange(len(widths)), widths)

    def to_dict(self) -> dict[str, Any]:
        """Return the plain-JSON description that `from_dict` reads."""
        described: dict[str, Any] = {
            "name": self.name,
            "parameters": [parameter.to_dict() for parameter in self.parameters],
        }
        if self.constraints:
            described["constraints"] = [constraint.text for constraint in self.constraints]
        return described

    @classmethod
    def from_dict(cls, description: Mapping[str, Any]) -> Space:
        """Read `{"name": .., "parameters": [{"name", "type", ..}, ..], "constraints": [text, ..]}`.

        `spaces/space.schema.json` describes it; `Parameter.from_dict` lists the parameters' fields, and
        `Constraint` what a constraint may say. Where constraints forbid the default, the values of parameters
        without one are moved. Raises SpaceError for anything else.
        """
        parameters = description.get("parameters") if isinstance(description, Mapping) else None
        if not isinstance(parameters, list) or not all(isinstance(item, Mapping) for item in parameters):
            raise SpaceError(
                'a space is {"name": .., "parameters": [{"name": .., "type": .., "values": [..]}, ..]}'
            )
        if unknown := set(description) - {"$schema", "name", "parameters", "constraints"}:
            raise SpaceError(
                f"unknown field {sorted(map(str, unknown))[0]!r} of a space: "
                "it has name, parameters and constraints"
            )
        name, constraints = description.get("name", "space"), description.get("constraints", [])
        if not isinstance(name, str):
            raise SpaceError(f"a space's name is a text, not {name!r}")
        if not isinstance(constraints, list):
            raise SpaceError(
                f'constraints are a list of texts such as ["a * b <= 1024"], not {constraints!r}'
            )
        read = [Parameter.from_dict(item) for item in parameters]
        movable = [item["name"] for item in parameters if "default" not in item]
        return cls(read, name, constraints, movable)

    @classmethod
    def load(cls, path: str | Path) -> Space:
        """Read a space from a JSON file. Raises SpaceError when the file is not one."""
        try:
            description = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise SpaceError(f"cannot read the space {path}: {error.strerror}") from error
        except ValueError as error:
            raise SpaceError(f"{path} is not JSON: {error}") from error
        return cls.from_dict(description)

    def save(self, path: str | Path) -> None:
        """Write the space as JSON that `load` reads."""
        Path(path).write_text(json.dumps(self.to_dict(), indent=2) + "\n", encoding="utf-8")

    def _active(self, index: int) -> dict[str, bool]:
        """Return for each parameter with a condition whether it is active."""
        if not self.conditions:
            return {}
        codes = {name: np.array([index // step % size]) for name, (step, size) in self._strides.items()}
        return {name: bool(mask.all()) for name, mask in self.conditions.active(codes).items()}

    def _constrain(self, constraints: Sequence[str]) -> None:
        """Read constraints and conditions; an inactive parameter is then at its current default."""
        self.conditions = Conditions(self.parameters)
        self.constraints = tuple(self.conditions.constraint(text) for text in constraints)
        self.constraint_clauses = tuple(
            clause for constraint in self.constraints for clause in constraint.clauses
        )
        self.condition_clauses = self.conditions.clauses()

    def _allow_default(self, movable: Collection[str]) -> None:
        """Move a forbidden default in `movable` parameters, or raise ConstraintError."""
        default = {parameter.name: parameter.default for parameter in self.parameters}
        index = self.index_of(default)
        broken = [
            item.text for item in self.constraints if not self.evaluate(item.clauses, np.array([index]))
        ]
        if not broken:
            return
        texts = ", ".join(repr(constraint.text) for constraint in self.constraints)
        if not self.region.size:
            raise ConstraintError(f"no configuration keeps all of {texts}: they contradict each other")
        nearest = self.region.nearest(index, movable)
        if nearest is None:
            raise ConstraintError(f"no configuration was found that keeps all of {texts}")
        moved = {
            name: value
            for name, value in self.decode(nearest).items()
            if value is not None and value != default[name]
        }
        if moved.keys() - set(movable):
            raise ConstraintError(
                f"the default breaks the constraint {broken[0]!r}: give other defaults, such as {moved}"
            )
        self.parameters = tuple(
            replace(parameter, default=moved.get(parameter.name, parameter.default))
            for parameter in self.parameters
        )
        if self.conditions:  # an inactive parameter stays at its default, which has moved
            self.__dict__.pop("region", None)
            self._constrain([constraint.text for constraint in self.constraints])


def read_index(space: Space, number: Any) -> int:
    """Return the index that a saved state names.

    Raises TypeError unless it is a whole number, StateError outside.
    """
    index = operator.index(number)
    if not 0 <= index < len(space):
        raise StateError(f"the state is damaged: index {index} is outside 0 .. {len(space) - 1}")
    return index


def _missing(name: str, configuration: Mapping[str, object]) -> ConfigurationError:
    return ConfigurationError(f"parameter {name!r} is missing from {dict(configuration)}")
