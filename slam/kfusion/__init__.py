"""KinectFusion (Newcombe et al. 2011) with SLAMBench's algorithmic parameters, on OpenCL and WebGPU."""
