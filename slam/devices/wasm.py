"""WebAssembly on the processor through wasmtime: where no driver is needed, or none works.

This is the only module that imports wasmtime, on first use: importing this module touches nothing.
"""

from __future__ import annotations

import os
import platform
import sys
import threading
import weakref
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slam.devices.device import Device, DeviceError, DeviceMemoryError
from slam.devices.layout import Layout

if TYPE_CHECKING:
    from wasmtime import Engine, Func, MemoryType, Module, SharedMemory, Store

LAYOUT = Layout("rows")
LARGEST_MEMORY = 2**32  # bytes that 32-bit addresses reach
PAGE = 2**16
OWN = PAGE  # bytes at the start of memory that belong to the module
ALIGNMENT = 64  # of all that is placed in memory: no two things share a cache line
STACK = 2**16  # bytes for each thread; its work-item lies above it
MOST_THREADS = 64
CPUINFO = Path("/proc/cpuinfo")
MACHINES = ("x86_64", "AMD64", "aarch64", "arm64", "ARM64")  # for which wasmtime has wheels


def has_wheel() -> bool:
    """Whether wasmtime publishes wheels for this processor."""
    return platform.machine() in MACHINES and sys.maxsize > 2**32


def list_devices() -> list[Device]:
    """The processor, as the one device. Empty where wasmtime is not installed or does not load."""
    try:
        import wasmtime  # noqa: F401
    except (ImportError, OSError, RuntimeError):  # RuntimeError: wasmtime does not know this processor
        return []
    memory = _memory()
    return [
        Device(
            backend="wasm",
            platform="wasmtime",
            version=f"wasmtime {version('wasmtime')}",
            name=_processor(),
            driver=version("wasmtime"),
            kind="cpu",
            compute_units=min(_processors(), MOST_THREADS),
            max_allocation=min(memory or LARGEST_MEMORY, LARGEST_MEMORY),
            global_memory=memory,
            double_precision=True,
            handle=None,
        )
    ]


def _processor() -> str:
    """The processor's name, as far as the system tells it."""
    try:
        lines = CPUINFO.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


def _processors() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _memory() -> int:
    """Bytes of the machine's memory; 0 where unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return 0


def aligned(address: int) -> int:
    """The first address from `address` on at which something can be placed."""
    return -(-address // ALIGNMENT) * ALIGNMENT


class WebAssemblySession:
    """Modules compiled for the processor, and executed by `threads` threads (default: one a processor).

    Kernels are laid out by rows.
    """

    def __init__(self, device: Device, layout: Layout | None = None, threads: int | None = None) -> None:
        if layout is not None and layout.kind != LAYOUT.kind:
            raise ValueError(f"kernel layout {layout.kind}: WebAssembly's kernels are laid out by rows")
        from wasmtime import Config, Engine

        self.device = device
        self.layout = LAYOUT
        self.threads = threads or device.threads or 1
        config = Config()
        config.shared_memory = True
        self._engine = Engine(config)
        self._modules: dict[Path, Module] = {}

    @property
    def first_free(self) -> int:
        """The first address that is left to the launches and buffers of a plan."""
        return OWN + ALIGNMENT + self.threads * (STACK + ALIGNMENT)

    def machine(self, path: Path, nbytes: int) -> Machine:
        """The module of the file `path` with a memory of `nbytes`, all 0.

        Raises DeviceError where the module cannot be compiled, and DeviceMemoryError where memory ends.
        """
        from wasmtime import Limits, MemoryType, Module, WasmtimeError

        self.device.check_allocation(nbytes, "a configuration")
        try:
            if path not in self._modules:
                self._modules[path] = Module.from_file(self._engine, str(path))
        except WasmtimeError as error:
            raise DeviceError(f"wasmtime refused {path.name}: {error}") from error
        pages = -(-nbytes // PAGE)
        try:
            memory = _shared_memory(self._engine, MemoryType(Limits(pages, pages), shared=True))
        except WasmtimeError as error:
            raise DeviceMemoryError(f"no memory of {nbytes / 2**20:.0f} MiB is free: {error}") from error
        return Machine(self._engine, self._modules[path], memory, self.threads)


def _shared_memory(engine: Engine, kind: MemoryType) -> SharedMemory:
    from wasmtime import SharedMemory, _ffi

    class Memory(SharedMemory):
        """wasmtime 50.0.1 hands instances a pointer to the pointer, which ctypes refuses."""

        def _as_extern(self) -> Any:
            union = _ffi.wasmtime_extern_union(sharedmemory=self.ptr())
            return _ffi.wasmtime_extern_t(_ffi.WASMTIME_EXTERN_SHAREDMEMORY, union)

    return Memory(engine, kind)


class Machine:
    """A module with its memory and its threads, until nothing refers to it any more.

    `bytes` is the memory: uint8.
    """

    def __init__(self, engine: Engine, module: Module, memory: SharedMemory, threads: int) -> None:
        self.bytes = np.ctypeslib.as_array(memory.data_ptr(), (memory.data_len(),))
        self._memory = memory  # whose end would be that of `bytes`
        self._threads = threads
        self._store, self._exports = _instance(engine, module, memory, 0)
        self._run: Func = self._exports["run"]
        if threads > 1:
            others = [
                threading.Thread(target=_serve, args=(engine, module, memory, number, threads), daemon=True)
                for number in range(1, threads)
            ]
            for other in others:
                other.start()
            weakref.finalize(self, _end, self._exports["stop"], self._store, others)

    def run(self, launches: int, count: int) -> None:
        """Execute `count` launches, whose addresses lie from the address `launches` on, and wait."""
        self._run(self._store, OWN, launches, count, self._threads)


def _instance(engine: Engine, module: Module, memory: SharedMemory, number: int) -> tuple[Store, Any]:
    """The module for the thread `number`, with a stack and a place for its work-item."""
    from wasmtime import Instance, Store

    store = Store(engine)
    exports: Any = Instance(store, module, [memory]).exports(store)
    top = OWN + ALIGNMENT + number * (STACK + ALIGNMENT) + STACK
    exports["__stack_pointer"].set_value(store, top)
    exports["__tls_base"].set_value(store, top)
    return store, exports


def _serve(engine: Engine, module: Module, memory: SharedMemory, number: int, threads: int) -> None:
    store, exports = _instance(engine, module, memory, number)
    exports["serve"](store, OWN, threads)


def _end(stop: Func, store: Store, others: list[threading.Thread]) -> None:
    stop(store, OWN)
    for other in others:
        other.join()
