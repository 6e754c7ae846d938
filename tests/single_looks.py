"""What tests wait for by themselves instead of through tests.waiting, found in their source."""

import ast
from collections.abc import Iterator

CLOCKS = {"monotonic", "perf_counter", "process_time", "time"}
ACTIONS = {"click", "dblclick", "tap", "fill", "press", "check", "uncheck", "select_option"}
LOOKS = {
    "is_visible", "is_hidden", "is_enabled", "is_checked", "count", "inner_text", "text_content",
    "input_value", "get_attribute",
}  # fmt: skip


def offences(source: str) -> list[tuple[int, str]]:
    """The line of each offence in a module's `source`, with what is wrong there, in their order.

    Programs that the module holds as strings do not count.
    """
    tree = ast.parse(source)
    finders = (_sleeps, _waiting_loops, _timing_assertions, _looks_after_actions)
    return sorted({offence for finder in finders for offence in finder(tree)})


def _sleeps(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node) in {"sleep", "wait_for_timeout"}:
            yield node.lineno, "it sleeps: wait with `until`"


def _waiting_loops(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.While) and any(map(_is_clock, ast.walk(node))):
            yield node.lineno, "a waiting loop of its own: wait with `until`"


def _timing_assertions(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Assertions about time that passed: a difference of clocks, also under names of the same function."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Module):
            continue
        moments, durations = set[str](), set[str]()
        for node in sorted(_own_nodes(function), key=lambda node: node.lineno):
            if isinstance(node, ast.Assign | ast.AnnAssign | ast.NamedExpr) and node.value is not None:
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = {part.id for one in targets for part in ast.walk(one) if isinstance(part, ast.Name)}
                if _holds_duration(node.value, moments, durations):
                    durations |= names
                elif any(_is_clock(part) for part in ast.walk(node.value)):
                    moments |= names
            elif isinstance(node, ast.Assert) and any(
                isinstance(part, ast.Compare) and _holds_duration(part, moments, durations)
                for part in ast.walk(node.test)
            ):
                yield node.lineno, "an assertion about time that passed: let the test move a clock"


def _looks_after_actions(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Assertions on what a page shows at once, in the statements directly after an action on it."""
    for node in ast.walk(tree):
        for field in ("body", "orelse", "finalbody"):
            statements = getattr(node, field, [])
            acted = False
            for statement in statements if isinstance(statements, list) else []:
                acted = _is_action(statement) or (acted and isinstance(statement, ast.Assert))
                if isinstance(statement, ast.Assert) and acted and any(map(_is_look, _at_once(statement))):
                    yield statement.lineno, "a single look after an action: `expect` or `until` waits for it"


def _own_nodes(function: ast.AST) -> Iterator[ast.stmt | ast.NamedExpr]:
    """The statements and named expressions of `function`, without those of functions inside it."""
    for child in ast.iter_child_nodes(function):
        if isinstance(child, ast.stmt | ast.NamedExpr):
            yield child
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from _own_nodes(child)


def _holds_duration(node: ast.AST, moments: set[str], durations: set[str]) -> bool:
    """Whether `node` subtracts from or by a clock, or names such a difference."""
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and part.id in durations:
            return True
        if isinstance(part, ast.BinOp) and isinstance(part.op, ast.Sub):
            sides = [each for side in (part.left, part.right) for each in ast.walk(side)]
            if any(_is_clock(each) or (isinstance(each, ast.Name) and each.id in moments) for each in sides):
                return True
    return False


def _at_once(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes below `node` that are computed once: not what `until` asks again."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.Lambda):
            yield child
            yield from _at_once(child)


def _is_action(statement: ast.AST) -> bool:
    call = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr in ACTIONS


def _is_look(node: ast.AST) -> bool:
    """Whether `node` asks a page. Lists count an argument; querysets come from a manager."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
        return False
    managers = (part.attr == "objects" for part in ast.walk(node) if isinstance(part, ast.Attribute))
    return node.func.attr in LOOKS and not (node.func.attr == "count" and node.args) and not any(managers)


def _is_clock(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call):
        return False
    of_module = isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") == "time"
    return _called(node) in CLOCKS and (of_module or _called(node) != "time")


def _called(node: ast.Call) -> str:
    return str(getattr(node.func, "attr", getattr(node.func, "id", "")))
