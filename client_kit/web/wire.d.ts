/* From the package `wire`. Written by docs/tools/wire_types.py: do not edit. */

/** A configuration that this device is asked to measure, and the reason. */
export interface Assignment {
  name: string;
  why: string;
}

/** A part of the sequence. `url` is relative to the server; its content never changes. */
export interface Chunk {
  sha256: string;
  bytes: number;
  url: string;
}

/** The pack with the colour frames of a sequence. */
export interface Colour {
  name: string;
  sha256: string;
  chunks: Chunk[];
}

/** A point: its name, parameters, and predictions by the reference device (seconds per frame, metres). */
export interface Configuration {
  name: string;
  parameters: Record<string, boolean | number | string>;
  predicted: Predicted;
  backends?: string[];
  plan?: ContentReference;
  shaders?: ContentReference;
  wasm?: WebAssembly;
  band?: number;
  trajectory?: ContentReference;
  reference_ate?: Errors;
  skipped?: number;
  learned_on?: SequenceResult[];
  held_out?: SequenceResult[];
}

/** Immutable content at `url`, relative to the server. */
export interface ContentReference {
  sha256: string;
  url: string;
}

/** A request for a token, from a program and its version, never a person. */
export interface Enrolment {
  app: string;
  app_version: string;
  consent_version: number;
}

/** Distances (m) of a trajectory from the truth, once its first pose was laid on the first true one. */
export interface Errors {
  ate_max: number;
  ate_mean: number;
  ate_rmse: number;
}

/** What a client is asked to measure now. */
export interface Manifest {
  application: string;
  front_version: string;
  configurations: Configuration[];
  protocol: Protocol;
  sequence: Sequence;
  consent_version: number;
  minimum_app_version: string;
  accepting: boolean;
  message: string | null;
  assigned?: Assignment[];
  assigned_message?: string | null;
}

/** Ratios to the runtime of the default in the same round, on the sequence that clients measure. */
export interface OnSequence {
  runtime_ratio: number;
  stages: Record<string, number>;
  low: number;
  high: number;
  rounds: number;
  processor_ratio?: number | null;
}

/** Measurements of the reference device: seconds per frame, metres. Errors are None if tracking was lost. */
export interface Predicted {
  runtime: number;
  ate_max: number | null;
  ate_mean: number | null;
  runtime_ratio?: number | null;
  runtime_low?: number | null;
  runtime_ratio_low?: number | null;
  runtime_high?: number | null;
  runtime_ratio_high?: number | null;
  measurements?: number | null;
  on_sequence?: OnSequence | null;
}

/** How clients measure. Times are seconds, `max_ate` metres, frames are counted from 0. */
export interface Protocol {
  version: number;
  warmup_frames: number;
  frames: number;
  first_counted_frame: number;
  order: string[];
  repeats: number;
  rest_seconds: number;
  max_ate: number;
}

/** One run of a configuration over the sequence. Times are microseconds, errors metres. */
export interface Run {
  id: string;
  configuration: string;
  repeat: number;
  order: number;
  status: "failed" | "ok";
  frame_us: number[];
  failure?: string | null;
  stages_us?: Record<string, number[]> | null;
  tracked?: (boolean | null)[] | number | null;
  ate_max?: number | null;
  ate_mean?: number | null;
  ate_rmse?: number | null;
  cpu_us?: number | null;
  waited_us?: number | null;
  deviation?: number | null;
}

/** The state of the device, t seconds after the start. Null or absent if the platform hides it. */
export interface Sample {
  t: number;
  temperature_c?: number | null;
  cpu_mhz?: number | null;
  battery?: number | null;
}

/** The pack to download: depth frames, camera, ground truth. `colour` is null if no colour is needed. */
export interface Sequence {
  name: string;
  sha256: string;
  width: number;
  height: number;
  frames: number;
  volume_size: number | null;
  initial_position: number[] | null;
  chunks: Chunk[];
  colour: Colour | null;
}

/** The largest error (m) and the most lost frames of all measurements on one sequence. */
export interface SequenceResult {
  sequence: string;
  ate_max: number;
  lost: number;
}

/** Runs measured one after another by the protocol of one front. */
export interface Session {
  id: string;
  started_at: string;
  application: string;
  front_version: string;
  protocol_version: number;
  backend: "cpu" | "cuda" | "metal" | "opencl" | "vulkan" | "wasm" | "webgpu";
  runs: Run[];
  empty_frame_us?: number | null;
  stage_clock?: "device" | "none" | "wall" | null;
  threads?: number | null;
  threads_claimed?: number | null;
  blocks_repeated?: number | null;
  samples: Sample[];
}

/** A request with measured sessions. */
export interface Submission {
  schema_version: 1;
  app_version: string;
  consent_version: number;
  device: Record<string, unknown>;
  sessions: Session[];
  show_model?: boolean | null;
}

/** The plan of a frame in the rows layout, and the WebAssembly module with its kernels. */
export interface WebAssembly {
  plan: ContentReference;
  module: ContentReference;
}
