"""Dense SLAM on OpenCL and WebGPU: time and trajectory error of a configuration on an RGB-D sequence."""
