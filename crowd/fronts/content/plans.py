"""Frame plans for clients: the work of a frame, as data.

A plan is computed from the configuration, the camera of the sequence and this version of the program. WebGPU
executes one with shaders, the WGSL texts of its kernels. WebAssembly executes one of the rows layout with the
module, which has the kernels of all such plans. All are named by their digests.
"""

import hashlib
import json
import logging
from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from crowd.fronts import selectors, sequences
from slam.configuration import ConfigurationError
from slam.definitions import SYSTEMS
from slam.kfusion.definition import KFUSION
from wire.front import DEFAULT, Front, Point
from wire.protocol import FIRST_COUNTED_FRAME, VERSION

if TYPE_CHECKING:
    from slam.plans.plan import Plan

# What a plan's buffers may take together in WebAssembly: phones end pages that need much more.
LARGEST_WASM_MEMORY = 256 << 20  # bytes
# The page measures all configurations of a session with the same one of these.
BROWSER_BACKENDS = ("webgpu", "wasm")

log = logging.getLogger(__name__)


class Document(NamedTuple):
    """JSON with its digest."""

    content: str
    sha256: str


class Module(NamedTuple):
    """A WebAssembly module with its digest."""

    content: bytes
    sha256: str


class FramePlan(NamedTuple):
    """A plan for WebGPU, the WGSL texts of its kernels, and the backends whose limits the plans keep.

    `rows`: the plan for WebAssembly, which `module` executes.
    """

    plan: Document
    shaders: Document
    rows: Document
    backends: tuple[str, ...]


def has_plans(application: str) -> bool:
    """Whether the frames of `application` are data, which a browser can execute.

    KinectFusion's alone are: `make` knows no other.
    """
    return application in SYSTEMS and SYSTEMS[application].plan is not None


def of_point(front: Front, point: Point) -> FramePlan | None:
    """The plan of `point` of `front`.

    None if the system has no plans, the sequence is missing or damaged, or this version of the program
    refuses the parameters.
    """
    if not has_plans(front.application):
        return None
    try:
        return make(front.sequence["sha256"], point.parameters)
    except (ConfigurationError, sequences.SequenceError) as error:
        log.warning("%s has no plan for %s: %s", front.slug, point.name, error)
        return None


def browsers_measure(front: Front) -> bool:
    """Whether browsers can measure a session of `front`: all its configurations with WebGPU, or all with
    WebAssembly."""
    measured = (point for point in front.points if point.name in front.protocol.order)
    planned = [of_point(front, point) for point in measured]
    return any(
        all(plan is not None and backend in plan.backends for plan in planned) for backend in BROWSER_BACKENDS
    )


def program_digest(application: str, sequence: str, parameters: Mapping[str, Any]) -> str | None:
    """The digest of the plan and the shaders that this program makes for `parameters` on the sequence with
    the digest `sequence`.

    A client of a program with another digest computes something else. None for a system without plans.
    Raises as `make`.
    """
    if not has_plans(application):
        return None
    made = make(sequence, parameters)
    return hashlib.sha256(f"{made.plan.sha256} {made.shaders.sha256}".encode()).hexdigest()


def outdated(front: Front) -> tuple[str, ...]:
    """The names of the points and probes of `front` that were prepared with another program than this one.

    All are, if clients no longer measure by its protocol. Points of a system without plans record no program,
    and are otherwise never among them. Nothing is said while the sequence is missing.
    """
    every = (*front.points, *front.probes)
    if front.protocol.version != VERSION:
        return tuple(point.name for point in every)
    recorded = [point for point in every if point.program is not None]
    try:
        return tuple(point.name for point in recorded if point.program != _current_program(front, point))
    except sequences.SequenceError:
        return ()


def _current_program(front: Front, point: Point) -> str | None:
    """As `program_digest`; None if this program refuses the parameters."""
    try:
        return program_digest(front.application, front.sequence["sha256"], point.parameters)
    except ConfigurationError:
        return None


def to_prepare() -> tuple[str, ...]:
    """The fronts that clients would measure now, had they been prepared with this program."""
    applications = sorted({application for _, application in selectors.names()})
    fronts = map(selectors.current, applications)
    return tuple(front.slug for front in fronts if front is not None and outdated(front))


def find(sha256: str) -> str | None:
    """The JSON of the plan with the digest SHA256, of any released front; None without one. One query."""
    return _find(sha256, lambda plan: (plan.plan, plan.rows))


def find_shaders(sha256: str) -> str | None:
    """The JSON of the shaders with the digest SHA256, by kernel; None without one. One query."""
    return _find(sha256, lambda plan: (plan.shaders,))


def find_module(sha256: str) -> bytes | None:
    """The module, if it has the digest SHA256."""
    return module().content if sha256 == module().sha256 else None


def _find(sha256: str, of_plan: Callable[[FramePlan], Iterable[Document]]) -> str | None:
    if not sequences.DIGEST.fullmatch(sha256):
        return None
    released = tuple(row for name in SYSTEMS if has_plans(name) for row in selectors.released(name))
    documents = (document for plan in _plans_of_fronts(released) for document in of_plan(plan))
    return next((document.content for document in documents if document.sha256 == sha256), None)


def make(sequence: str, parameters: Mapping[str, Any]) -> FramePlan:
    """The plan for `parameters` on the sequence with the digest `sequence`.

    Raises ConfigurationError if the parameters do not fit the camera, and sequences.SequenceError if the
    sequence is missing or damaged.
    """
    return _build(sequence, tuple(parameters.items()))


def workload(front: Front, point: Point) -> Mapping[tuple[str, str], float] | None:
    """The resources that `point` of `front` uses in each stage over the counted frames; None without a plan.

    `slam.kfusion.work` defines them.
    """
    if of_point(front, point) is None:
        return None
    parameters = tuple(point.parameters.items())
    return _workload(front.sequence["sha256"], parameters, *_counted_frames(front), point.skipped or 0.0)


def stage_ratios(front: Front, point: Point) -> Mapping[str, tuple[float, float]] | None:
    """How many times faster than the default each stage of `point` may be; None without a plan.

    `slam.kfusion.work` defines them. The share of skipped frames is that of the reference.
    """
    default = front.point(DEFAULT)
    if default is None or not has_plans(front.application):
        return None
    both = (tuple(one.parameters.items()) for one in (default, point))
    try:
        return _stage_ratios(front.sequence["sha256"], *both, *_counted_frames(front), point.skipped)
    except (ConfigurationError, sequences.SequenceError):
        return None


def stage_ratios_on(
    sequence: str, default: Mapping[str, Any], parameters: Mapping[str, Any], frames: int | None
) -> Mapping[str, tuple[float, float]] | None:
    """As `stage_ratios`, for `parameters` of kfusion over `frames` (None: all) of the sequence `sequence`."""
    both = (tuple(one.items()) for one in (default, parameters))
    try:
        last = len(sequences.open_pack(sequence)) if frames is None else frames
        return _stage_ratios(sequence, *both, FIRST_COUNTED_FRAME, last)
    except (ConfigurationError, sequences.SequenceError):
        return None


def _counted_frames(front: Front) -> tuple[int, int]:
    """The first counted frame of `front`'s protocol, and the one after the last."""
    return front.protocol.first_counted_frame, front.protocol.frames


@lru_cache(maxsize=1)
def _plans_of_fronts(released: tuple[tuple[str, str], ...]) -> tuple[FramePlan, ...]:
    """The plans of all configurations of the fronts `released` (slug and digest)."""
    fronts = [selectors.front(slug) for slug, _ in released]
    plans = [of_point(front, point) for front in fronts if front for point in (*front.points, *front.probes)]
    return tuple(plan for plan in plans if plan)


@cache
def module() -> Module:
    """The module of KinectFusion's kernels."""
    from slam.kfusion.pipeline import FOLDERS
    from slam.plans.wasm import MODULE

    content = (FOLDERS[0] / MODULE).read_bytes()
    return Module(content, hashlib.sha256(content).hexdigest())


@cache
def _build(sequence: str, parameters: tuple[tuple[str, Any], ...]) -> FramePlan:
    # Imported here, because commands that only read tables do not need these modules.
    from slam.devices import webgpu
    from slam.kfusion.pipeline import FOLDERS
    from slam.plans.declarations import shaders

    made, rows = _plan(sequence, parameters), _plan(sequence, parameters, "rows")
    fits = {
        "webgpu": max(_buffer_bytes(made)) <= webgpu.LIMITS["max-storage-buffer-binding-size"],
        "wasm": sum(_buffer_bytes(rows)) < LARGEST_WASM_MEMORY,
    }
    texts = json.dumps(shaders(made, FOLDERS))
    return FramePlan(
        _document(made.to_json()),
        _document(texts),
        _document(rows.to_json()),
        tuple(backend for backend in KFUSION.backends if fits.get(backend, True)),
    )


def _buffer_bytes(plan: "Plan") -> list[int]:
    """The bytes of each buffer of `plan`, all planes together."""
    return [buffer.planes * buffer.nbytes(plan.state_type.itemsize) for buffer in plan.buffers]


@cache
def _workload(
    sequence: str, parameters: tuple[tuple[str, Any], ...], first: int, frames: int, skipped: float
) -> Mapping[tuple[str, str], float]:
    from slam.kfusion.work import work

    return work(_plan(sequence, parameters), range(first, frames), skipped)


@lru_cache(maxsize=1000)  # searches measure any number of configurations
def _stage_ratios(
    sequence: str,
    default: tuple[tuple[str, Any], ...],
    parameters: tuple[tuple[str, Any], ...],
    first: int,
    frames: int,
    skipped: float | None = None,
) -> Mapping[str, tuple[float, float]]:
    from slam.kfusion.work import stage_ratios

    before, after = _plan(sequence, default), _plan(sequence, parameters)
    return stage_ratios(before, after, range(first, frames), skipped)


def _plan(sequence: str, parameters: tuple[tuple[str, Any], ...], layout: str = "pixels") -> "Plan":
    from slam.devices.layout import Layout
    from slam.kfusion.configuration import Configuration
    from slam.kfusion.plan import plan
    from slam.system import scene_of

    return plan(
        Configuration.from_mapping(dict(parameters)), scene_of(sequences.open_pack(sequence)), Layout(layout)
    )


def _document(content: str) -> Document:
    return Document(content, hashlib.sha256(content.encode()).hexdigest())
