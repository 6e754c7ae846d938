"""Remedies where OpenCL cannot be used, in one line for each platform."""

import sys
from pathlib import Path

from client_kit.device.description import is_android

# Where the makers of Android devices put their OpenCL, by the family of the graphics chip.
VENDOR_LIBRARIES = {
    "Adreno": ("vendor/lib64/libOpenCL_adreno.so", "vendor/lib64/libCB.so"),
    "Mali": ("vendor/lib64/egl/libGLES_mali.so", "vendor/lib64/libGLES_mali.so"),
    "PowerVR": ("vendor/lib64/libPVROCL.so",),
}
ANY_LIBRARY = ("vendor/lib64/libOpenCL.so", "system/vendor/lib64/libOpenCL.so")

ADRENO = "start again with LD_LIBRARY_PATH=/vendor/lib64:$PREFIX/lib before the command, in that order"
MALI = "pkg install opencl-vendor-driver, then start again"
NO_LIBRARY = "this device has no OpenCL library for programs (none in /vendor/lib64)"
BUILD_ON_ANDROID = (
    "pkg install python-numpy clang cmake ninja ocl-icd opencl-headers, then pip install pyopencl"
)
LOADERS = {
    "linux": "install an OpenCL loader (Debian: ocl-icd-libopencl1) and a driver for the processor or GPU",
    "darwin": "conda install -c conda-forge pyopencl pocl ocl_icd_wrapper_apple brings loader and drivers",
    "win32": "install the graphics driver of the GPU's maker, which brings OpenCL",
}


def remedy(error: Exception, root: Path = Path("/"), system: str = sys.platform) -> str:
    """Why no OpenCL device can be used, and a remedy.

    `error` is the result of the search: a module that is missing or does not load, or no device.
    """
    android = system.startswith(("linux", "android")) and is_android(root)
    if isinstance(error, ModuleNotFoundError):
        name = error.name or str(error)
        help_ = BUILD_ON_ANDROID if android else f"pip install {name}"
        return f"{name} is not installed here: {help_}"
    if isinstance(error, ImportError):
        module = (error.name or "pyopencl").partition(".")[0]
        if module != "pyopencl":
            help_ = BUILD_ON_ANDROID if android else f"pip install --force-reinstall {module}"
            return f"{module} does not load here ({error}): {help_}"
        help_ = "pkg install ocl-icd" if android else LOADERS.get(system, LOADERS["linux"])
        return f"pyopencl does not load here ({error}): {help_}"
    return f"{error}; on this device: {_on_android(root)}" if android else str(error)


def _on_android(root: Path) -> str:
    family = next(
        (
            family
            for family, paths in VENDOR_LIBRARIES.items()
            if any((root / path).exists() for path in paths)
        ),
        None,
    )
    if family == "Mali":
        return MALI
    if family is not None or any((root / path).exists() for path in ANY_LIBRARY):
        return ADRENO
    return NO_LIBRARY
