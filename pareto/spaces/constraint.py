"""A known constraint: a condition on the parameters, checked once and then evaluated on whole columns."""

from __future__ import annotations

import ast
import difflib
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import ConstraintError
from pareto.numbers import is_finite, is_number
from pareto.spaces.parameter import Parameter, Value, key

Codes = Mapping[str, NDArray[np.integer]]  # value positions by parameter, of shapes that broadcast
Column = NDArray[Any]

LONGEST = 1000  # characters
DEEPEST = 100  # levels of the syntax tree: evaluation is recursive
SAME = 1e-12  # relative: 0.1 + 0.2 is 0.3, while whole numbers stay apart up to a million millions

NUMBER, TRUTH, TEXT = "a number", "a condition", "a text"


@dataclass(frozen=True)
class Clause:
    """One of the conditions that a constraint joins by `and`; `names` are the parameters it depends on."""

    names: tuple[str, ...]
    holds: Callable[[Codes], NDArray[np.bool_]]


class Constraint:
    """A condition such as `block_x * block_y <= 1024` or `tiling == 'none' or unroll >= 2`.

    Python's syntax and precedence, of which `+ - * / // % **`, comparisons (chained too), `and or not`,
    `in [..]`, min, max, abs, parentheses, numbers, texts and true and false are known; `&`, `|` and `~` may
    join conditions. A parameter whose name is not an identifier is written in backticks. Arithmetic is
    float64 (true counts as 1), numbers within 1e-12 of each other are equal, and no comparison with a
    division by zero holds. `clauses` hold all together; of the `alternatives`, which `or` joins, one has to
    hold.

    Raises ConstraintError with the invalid part and a remedy; its message begins with `label`.
    """

    def __init__(self, text: str, parameters: Sequence[Parameter], label: str = "constraint") -> None:
        if not isinstance(text, str) or not text.strip() or len(text) > LONGEST:
            raise ConstraintError(f"{label}: give a text of 1 to {LONGEST} characters, not {text!r:.80}")
        self.text = text
        reader = _Reader(text, parameters, label)
        self.clauses = tuple(reader.clause(node) for node in _conjuncts(reader.tree))
        self.alternatives = tuple(
            tuple(reader.clause(node) for node in _conjuncts(alternative))
            for alternative in _disjuncts(reader.tree)
        )
        used = {name for clause in self.clauses for name in clause.names}
        self.names = tuple(parameter.name for parameter in parameters if parameter.name in used)


@dataclass(frozen=True)
class _Term:
    """A part of an expression: its kind, the function of its column, and its value if constant."""

    kind: str
    column: Callable[[Codes], Column]
    source: str
    constant: Value | None = None
    parameter: Parameter | None = None


class _Reader:
    """Compiles the syntax tree of one constraint to functions of columns."""

    def __init__(self, text: str, parameters: Sequence[Parameter], label: str) -> None:
        self.text = text
        self.label = label
        self.parameters = {parameter.name: parameter for parameter in parameters}
        # Python reads identifiers in Unicode's normal form KC.
        self.identifiers = {unicodedata.normalize("NFKC", name): name for name in self.parameters}
        self.symbols: dict[object, int] = {}
        self.used: dict[str, None] = {}
        try:
            self.tree = ast.parse(self._identified(text), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else "it cannot be read"
            raise self.error(
                f"{reason}; write a condition such as 'a * b <= 1024' or 'a == 1 or b > 2'"
            ) from None

        level: list[ast.AST] = [self.tree]
        for _ in range(DEEPEST):
            level = [child for node in level for child in ast.iter_child_nodes(node)]
        if level:
            raise self.error(f"it is nested deeper than {DEEPEST} levels")

    def error(self, reason: str) -> ConstraintError:
        return ConstraintError(f"{self.label} {self.text!r}: {reason}")

    def clause(self, node: ast.expr) -> Clause:
        self.used = {}
        term = self._condition(node)
        if not self.used:
            raise self.error(f"{term.source!r} depends on no parameter")

        def holds(codes: Codes) -> NDArray[np.bool_]:
            with np.errstate(all="ignore"):  # undefined values become NaN, for which no comparison holds
                return np.asarray(term.column(codes), dtype=bool)

        return Clause(tuple(self.used), holds)

    def _identified(self, text: str) -> str:
        """Return `text` with names in backticks replaced by identifiers."""

        def stand_in(match: re.Match[str]) -> str:
            if not match[0].startswith("`"):
                return match[0]
            identifier = f"_backticks_{len(self.identifiers)}"
            self.identifiers[identifier] = match[0][1:-1]
            return identifier

        return re.sub(r"'[^']*'|\"[^\"]*\"|`[^`]*`", stand_in, text.strip())

    def _term(self, node: ast.expr) -> _Term:
        match node:
            case ast.Name():
                return self._name(node.id)
            case ast.Constant():
                return self._literal(node)
            case ast.BoolOp() | ast.Compare():
                return self._condition_of(node)
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=operand):
                inner = self._condition(operand)
                return _Term(TRUTH, lambda codes: ~_truth(inner, codes), ast.unparse(node))
            case ast.UnaryOp():
                operate = np.negative if isinstance(node.op, ast.USub) else np.positive
                return self._arithmetic(operate, [node.operand], node)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                return self._condition_of(node)
            case ast.BinOp() if type(node.op) in _OPERATORS:
                return self._arithmetic(_OPERATORS[type(node.op)], [node.left, node.right], node)
            case ast.Call(func=ast.Name(id="abs"), args=[argument], keywords=[]):
                return self._arithmetic(np.abs, [argument], node)
            case ast.Call(func=ast.Name(id="min" | "max" as name), args=[_, _, *_], keywords=[]):
                pick = np.minimum if name == "min" else np.maximum
                return self._arithmetic(lambda *columns: reduce(pick, columns), node.args, node)
        raise self.error(
            f"{ast.unparse(node)!r} is not understood: use parameters, numbers, texts, + - * / // % **, "
            "comparisons, and, or, not, in [..], abs(x), min(x, y), max(x, y)"
        )

    def _name(self, identifier: str) -> _Term:
        name = self.identifiers.get(identifier, identifier)
        if name not in self.parameters:
            if name.lower() in ("true", "false"):
                return _constant(TRUTH, name.lower() == "true", name)
            close = difflib.get_close_matches(name, self.parameters, n=1)
            hint = f"did you mean {close[0]!r}? This" if close else "this"
            raise self.error(
                f"unknown parameter {name!r}: {hint} space has {', '.join(self.parameters)}; "
                "texts are written in quotes"
            )
        self.used[name] = None
        parameter = self.parameters[name]
        kind = _kind(parameter)
        if kind == TEXT:
            table = np.array([self._symbol(value) for value in parameter.values])
        else:
            table = np.array(parameter.values, dtype=bool if kind == TRUTH else np.float64)
        return _Term(kind, lambda codes: table[codes[name]], name, parameter=parameter)

    def _literal(self, node: ast.Constant) -> _Term:
        value, source = node.value, ast.unparse(node)
        if isinstance(value, bool):
            return _constant(TRUTH, value, source)
        if isinstance(value, str):
            return _Term(TEXT, _always(self._symbol(value)), source, constant=value)
        if is_number(value) and is_finite(value):  # type: ignore[arg-type]
            return _constant(NUMBER, value, source)  # type: ignore[arg-type]
        raise self.error(f"{source:.40} is neither a number, a text nor true or false")

    def _symbol(self, value: Value) -> int:
        return self.symbols.setdefault(key(value), len(self.symbols))

    def _condition(self, node: ast.expr) -> _Term:
        term = self._term(node)
        if term.kind != TRUTH:
            raise self.error(f"{term.source!r} is {term.kind}, not a condition: compare it with something")
        return term

    def _condition_of(self, node: ast.expr) -> _Term:
        source = ast.unparse(node)
        match node:
            case ast.BoolOp(op=op, values=values):
                return self._joined(isinstance(op, ast.And), values, source)
            case ast.BinOp(op=op, left=left, right=right):
                return self._joined(isinstance(op, ast.BitAnd), [left, right], source)
            case ast.Compare(ops=[operator], left=left, comparators=[right]):
                return _Term(TRUTH, self._comparison(operator, left, right), source)
        return self._joined(True, _conjuncts(node), source)

    def _joined(self, conjunction: bool, nodes: Sequence[ast.expr], source: str) -> _Term:
        terms = [self._condition(node) for node in nodes]
        join = np.logical_and if conjunction else np.logical_or
        return _Term(TRUTH, lambda codes: reduce(join, (_truth(term, codes) for term in terms)), source)

    def _arithmetic(self, operate: Callable[..., Column], nodes: Sequence[ast.expr], node: ast.expr) -> _Term:
        terms = [self._term(item) for item in nodes]
        for term in terms:
            if term.kind == TEXT:
                raise self.error(f"{term.source!r} is a text: {ast.unparse(node)!r} needs numbers")
        return _Term(
            NUMBER, lambda codes: operate(*(_number(term, codes) for term in terms)), ast.unparse(node)
        )

    def _comparison(self, operator: ast.cmpop, left: ast.expr, right: ast.expr) -> Callable[[Codes], Column]:
        term = self._term(left)
        if isinstance(operator, (ast.In, ast.NotIn)):
            if not isinstance(right, (ast.List, ast.Tuple, ast.Set)) or not right.elts:
                raise self.error(f"{ast.unparse(right)!r} is not a list: write {term.source} in [1, 2]")
            equal = [self._compared(np.equal, term, self._term(item)) for item in right.elts]
            inside = isinstance(operator, ast.In)
            return lambda codes: reduce(np.logical_or, [one(codes) for one in equal]) == inside
        if type(operator) not in _COMPARISONS:
            raise self.error("`is` is not understood: write == or !=")
        return self._compared(_COMPARISONS[type(operator)], term, self._term(right))

    def _compared(self, compare: np.ufunc, left: _Term, right: _Term) -> Callable[[Codes], Column]:
        if TEXT not in (left.kind, right.kind):
            return lambda codes: _compare(compare, _number(left, codes), _number(right, codes))
        if compare not in (np.equal, np.not_equal):
            raise self.error(
                f"texts have no order in {left.source!r} and {right.source!r}: use == or in [..]"
            )
        one, other = self._symbols_of(left, right), self._symbols_of(right, left)
        return lambda codes: compare(one(codes), other(codes))

    def _symbols_of(self, term: _Term, other: _Term) -> Callable[[Codes], Column]:
        """Return the values of `term` to compare with the text `other`, unless the two can never be equal."""
        constant, choices = term.constant, other.parameter
        if constant is None:
            if term.kind != TEXT:
                raise self.error(f"{term.source!r} is {term.kind}, {other.source!r} a text")
            return term.column
        if choices is not None and key(constant) not in {key(value) for value in choices.values}:
            raise self.error(f"{choices.name!r} is never {constant!r}: it is one of {choices.some_values()}")
        return _always(self._symbol(constant))


def _conjuncts(node: ast.expr) -> list[ast.expr]:
    """Return the conditions that `node` joins by `and`, `&` or a chain of comparisons; else itself."""
    match node:
        case ast.BoolOp(op=ast.And(), values=values):
            return [part for value in values for part in _conjuncts(value)]
        case ast.BinOp(op=ast.BitAnd(), left=left, right=right):
            return [*_conjuncts(left), *_conjuncts(right)]
        case ast.Compare(ops=[_, _, *_]):
            sides = [node.left, *node.comparators]
            pairs = zip(sides, node.ops, sides[1:], strict=False)
            return [ast.Compare(left, [operator], [right]) for left, operator, right in pairs]
    return [node]


def _disjuncts(node: ast.expr) -> list[ast.expr]:
    """Return the conditions that `node` joins by `or` or `|`; else itself."""
    match node:
        case ast.BoolOp(op=ast.Or(), values=values):
            return [part for value in values for part in _disjuncts(value)]
        case ast.BinOp(op=ast.BitOr(), left=left, right=right):
            return [*_disjuncts(left), *_disjuncts(right)]
    return [node]


def _always(value: Value) -> Callable[[Codes], Column]:
    column = np.asarray(value)
    return lambda _codes: column


def _constant(kind: str, value: bool | float, source: str) -> _Term:
    return _Term(kind, _always(float(value)), source, constant=value)


def _kind(parameter: Parameter) -> str:
    if parameter.levels:
        return NUMBER
    if all(isinstance(value, bool) for value in parameter.values):
        return TRUTH
    numbers = all(isinstance(value, (int, float)) for value in parameter.values)
    return NUMBER if numbers and not any(isinstance(value, bool) for value in parameter.values) else TEXT


def _number(term: _Term, codes: Codes) -> Column:
    return np.asarray(term.column(codes), dtype=np.float64)


def _truth(term: _Term, codes: Codes) -> Column:
    return np.asarray(term.column(codes), dtype=bool)


def _compare(compare: np.ufunc, left: Column, right: Column) -> Column:
    equal: Column = np.abs(left - right) <= SAME * np.maximum(np.abs(left), np.abs(right))
    if compare is np.equal:
        return equal
    holds: Column
    if compare in (np.less_equal, np.greater_equal):
        holds = compare(left, right) | equal
        return holds
    defined = ~(np.isnan(left) | np.isnan(right)) if compare is np.not_equal else True
    holds = compare(left, right) & ~equal & defined
    return holds


def _divided(divide: np.ufunc) -> Callable[[Column, Column], Column]:
    return lambda left, right: divide(left, np.where(right == 0, np.nan, right))


_OPERATORS: dict[type[ast.operator], Callable[..., Column]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: _divided(np.divide),
    ast.FloorDiv: _divided(np.floor_divide),
    ast.Mod: _divided(np.mod),
    ast.Pow: np.power,
}
_COMPARISONS: dict[type[ast.cmpop], np.ufunc] = {
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}
