"""Declarations that kernels of both languages share, generated from the plan: constants, the state, a
kernel's bindings.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from slam.plans.plan import STATE, Kernel, Number, Plan

OPENCL_TYPES = {"f32": "float", "i32": "int", "u32": "uint"}
# WGSL has no 16- and 8-bit values in storage: kernels unpack them from words.
WGSL_WORDS = {"u16": "u32", "u8": "u32"}
INCLUDE = re.compile(r'^#include "(.+)"\n', re.MULTILINE)


def opencl(plan: Plan) -> str:
    """The constants as macros and the state as a struct."""
    lines = [f"#define {name} {_literal(value, 'f')}" for name, value in plan.constants.items()]
    lines.append("typedef struct {")
    for member in plan.state:
        size = f"[{member.count}]" if member.count > 1 else ""
        lines.append(f"    {OPENCL_TYPES[member.type]} {member.name}{size};")
    return "\n".join([*lines, "} State;", ""])


def wgsl(plan: Plan, kernel: Kernel) -> str:
    """The constants, the state, and the bindings of `kernel`: its buffers in order, then its other
    parameters.
    """
    lines = [
        f"const {name} = {_literal(value, 'f') if isinstance(value, float) else value};"
        for name, value in plan.constants.items()
    ]
    lines.append("struct State {")
    for member in plan.state:
        kind = f"array<{member.type}, {member.count}>" if member.count > 1 else member.type
        lines.append(f"    {member.name}: {kind},")
    lines.append("}")
    binding = 0
    for parameter in kernel.parameters:
        if parameter.access is None:
            continue
        access = "read" if parameter.access == "read" else "read_write"
        element = WGSL_WORDS.get(parameter.type, parameter.type)
        if parameter.access == "atomic":
            element = f"atomic<{element}>"
        kind = "State" if parameter.type == STATE else f"array<{element}>"
        lines.append(f"@group(0) @binding({binding}) var<storage, {access}> {parameter.name}: {kind};")
        binding += 1
    scalars = uniforms(kernel)
    if scalars:
        lines.append("struct Parameters {")
        lines += [f"    {name}: {kind}," for name, kind in scalars]
        lines += ["}", f"@group(0) @binding({binding}) var<uniform> parameters: Parameters;"]
    return "\n".join([*lines, ""])


def shader(plan: Plan, kernel: Kernel, folders: Sequence[Path]) -> str:
    """The whole WGSL text of `kernel`: its declarations, then `<name>.wgsl` with every file that it includes,
    directly or not, once in its place. Each file lies in one of `folders`.
    """
    included: set[str] = set()

    def expanded(name: str) -> str:
        if name in included:
            return ""
        included.add(name)
        path = next(path for folder in folders if (path := folder / name).is_file())
        return INCLUDE.sub(lambda match: expanded(match[1]), path.read_text(encoding="utf-8"))

    return wgsl(plan, kernel) + expanded(f"{kernel.name}.wgsl")


def shaders(plan: Plan, folders: Sequence[Path]) -> dict[str, str]:
    """The WGSL text of each kernel that `plan` launches, by its name."""
    launched = {dispatch.kernel for dispatch in plan.dispatches}
    return {kernel.name: shader(plan, kernel, folders) for kernel in plan.kernels if kernel.name in launched}


def uniforms(kernel: Kernel) -> list[tuple[str, str]]:
    """Name and type of what `kernel` takes besides buffers, as they lie in its uniform buffer: vectors first,
    so that nothing needs padding."""
    scalars = [parameter for parameter in kernel.parameters if parameter.access is None]
    ordered = sorted(scalars, key=lambda parameter: parameter.type != "vec4f")
    return [(parameter.name, parameter.type) for parameter in ordered]


def _literal(value: Number, suffix: str) -> str:
    return f"{value!r}{suffix}" if isinstance(value, float) else str(value)
