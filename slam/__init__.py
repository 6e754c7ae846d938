"""Dense SLAM on OpenCL: run a configuration over an RGB-D sequence, get its time and its trajectory error."""
