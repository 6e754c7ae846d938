"""Dense SLAM on OpenCL and WebGPU: the time and the trajectory error of a configuration on an RGB-D sequence."""
