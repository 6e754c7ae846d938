"""One suite for the kernels of every backend: each gives what its NumPy reference gives."""
