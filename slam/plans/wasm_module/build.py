"""Compiles the OpenCL kernels of a plan to one WebAssembly module.

Every `.cl` file is compiled as OpenCL C, behind the plan's declarations and opencl.h, by a clang that knows
WebAssembly (of the package ziglang). Generated beside it: for each kernel a function that does some
work-items of a launch, and one that finds the kernel by its number. launches.c calls that.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from slam.devices.layout import SOLVERS, SUM_GROUP, SUMS
from slam.devices.opencl import source_text
from slam.plans import declarations
from slam.plans.plan import STATE, Kernel, Parameter, Plan

HERE = Path(__file__).parent
LARGEST_MEMORY = 2**32  # bytes
STACK = 2**10  # bytes: stays unused, as the host gives each thread its own; constants lie above it
# The options of OpenCL's own build (slam/devices/opencl.py): NaN lives.
LANGUAGE = (
    "-x", "cl", "-cl-std=CL1.2", "-cl-no-stdinc", "-Xclang", "-cl-ext=+cl_khr_fp64", "-DDOUBLE_PRECISION",
    "-cl-mad-enable", "-cl-unsafe-math-optimizations", "-Wno-bitwise-conditional-parentheses",
)  # fmt: skip
TARGET = (
    "--target=wasm32", "-O3", "-ffreestanding", "-fno-builtin", "-Wall", "-Werror", "-Wno-unused-function",
    "-msimd128", "-matomics", "-mbulk-memory", "-mnontrapping-fptoint",
)  # fmt: skip
EXPORTS = ("run", "serve", "stop", "__heap_base", "__stack_pointer", "__tls_base")
LINK = (
    "--no-entry", "--strip-all", "--import-memory", "--shared-memory", f"--max-memory={LARGEST_MEMORY}",
    "-z", f"stack-size={STACK}", *(f"--export={name}" for name in EXPORTS),
)  # fmt: skip
TYPES = {"f32": "float", "i32": "int", "u32": "uint", "u16": "ushort", "u8": "uchar", STATE: "State"}


def build(plan: Plan, folders: Sequence[Path], target: Path) -> None:
    """Write the module of all kernels of `plan`, whose sources lie in `folders`, to `target`.

    Kernels are numbered in the plan's order. Equal sources give equal bytes, wherever they lie. Raises
    subprocess.CalledProcessError where the compiler refuses a source, with its words in `stderr`.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        objects = [_compiled(HERE / "launches.c", folder / "launches.o")]
        (folder / "kernels.c").write_text(_finder(plan.kernels), encoding="utf-8")
        objects.append(_compiled(folder / "kernels.c", folder / "kernels.o"))
        for source in dict.fromkeys(kernel.source for kernel in plan.kernels):
            path = next(path for each in folders if (path := each / f"{source}.cl").is_file())
            kernels = [kernel for kernel in plan.kernels if kernel.source == source]
            text = folder / f"{source}.cl"
            text.write_text(_source(plan, path, kernels), encoding="utf-8")
            objects.append(_compiled(text, folder / f"{source}.o", *LANGUAGE))
        _zig("wasm-ld", *LINK, *map(str, objects), "-o", str(target))
        target.chmod(0o644)


def _source(plan: Plan, path: Path, kernels: Sequence[Kernel]) -> str:
    """What is compiled for one file of kernels."""
    sizes = {"SUMS": SUMS, "SUM_GROUP": SUM_GROUP, "SOLVERS": SOLVERS}
    macros = [f"#define {name} {size}\n" for name, size in sizes.items() if name not in plan.constants]
    header = (HERE / "opencl.h").read_text(encoding="utf-8")
    runners = [_runner(kernel) for kernel in kernels]
    return "".join([*macros, header, declarations.opencl(plan), source_text(path), *runners])


def _runner(kernel: Kernel) -> str:
    """A function that does the work-items `from` to `to` - 1 of a launch."""
    values = list(_arguments(kernel.parameters))
    constants = "".join(f"    {kind} a{i} = {value};\n" for i, (kind, value) in enumerate(values))
    arguments = ", ".join(f"a{i}" for i in range(len(values)))
    return (
        f"void run_{kernel.name}(global const uint *words, uint width, uint from, uint to);\n"
        f"void run_{kernel.name}(global const uint *words, uint width, uint from, uint to)\n{{\n{constants}"
        "    for (uint item = from; item < to; ++item) {\n"
        "        ITEM[0] = item % width;\n"
        "        ITEM[1] = item / width;\n"
        f"        {kernel.name}({arguments});\n"
        "    }\n}\n"
    )


def _arguments(parameters: Sequence[Parameter]) -> Iterator[tuple[str, str]]:
    """Type and value of each argument of a kernel, as they lie in the words of a launch."""
    place = 0
    for parameter in parameters:
        if parameter.type == "vec4f":
            parts = ", ".join(f"as_float(words[{place + part}])" for part in range(4))
            yield "const float4", f"(float4)({parts})"
            place += 4
        elif parameter.access is None:
            word = f"words[{place}]"
            yield f"const {TYPES[parameter.type]}", f"as_float({word})" if parameter.type == "f32" else word
            place += 1
        else:
            for _ in range(parameter.planes):
                kind = f"global {TYPES[parameter.type]} *"
                yield kind, f"({kind})words[{place}]"
                place += 1


def _finder(kernels: Sequence[Kernel]) -> str:
    """`launch` of launches.c."""
    parameters = "const unsigned *words, unsigned width, unsigned from, unsigned to"
    return "".join(
        [
            *(f"void run_{kernel.name}({parameters});\n" for kernel in kernels),
            f"void launch(unsigned kernel, {parameters});\n",
            f"void launch(unsigned kernel, {parameters})\n{{\n    switch (kernel) {{\n",
            *(
                f"    case {number}: run_{kernel.name}(words, width, from, to); break;\n"
                for number, kernel in enumerate(kernels)
            ),
            "    }\n}\n",
        ]
    )


def _compiled(source: Path, target: Path, *language: str) -> Path:
    _zig("clang", *TARGET, *language, "-c", str(source), "-o", str(target))
    return target


def _zig(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "ziglang", *arguments], check=True, capture_output=True, text=True)
