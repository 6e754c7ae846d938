"""The kernels of a system as one WebAssembly module: what turns the OpenCL files into it."""
