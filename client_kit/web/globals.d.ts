/* What TypeScript's libraries lack of WebGPU (https://www.w3.org/TR/webgpu/). */

declare const GPUBufferUsage: Readonly<
  Record<"MAP_READ" | "COPY_SRC" | "COPY_DST" | "UNIFORM" | "STORAGE" | "QUERY_RESOLVE", number>
>;
declare const GPUMapMode: Readonly<Record<"READ" | "WRITE", number>>;
declare const GPUShaderStage: Readonly<Record<"VERTEX" | "FRAGMENT" | "COMPUTE", number>>;

interface GPURequestAdapterOptions {
  featureLevel?: "core" | "compatibility";
}
