/** A thread of an execution in WebAssembly (wasm.js): it takes part in every frame until it is ended. */

/** @typedef {{module: WebAssembly.Module, memory: WebAssembly.Memory, stack: number, team: number, threads: number}} Part */

self.addEventListener("message", async ({ data }) => {
  const { module, memory, stack, team, threads } = /** @type {Part} */ (data);
  const { exports } = await WebAssembly.instantiate(module, { env: { memory } });
  const { serve, __stack_pointer, __tls_base } = /** @type {any} */ (exports);
  __stack_pointer.value = stack;
  __tls_base.value = stack;
  self.postMessage("ready");
  serve(team, threads);
});
