#!/bin/sh
# Installs the measuring client on Linux, macOS or Android (Termux) into ~/.frontrunner-client, or into the
# folder that FRONTRUNNER_CLIENT names, and says what is missing. From a clone:  sh install/client.sh
# Tried on Linux; macOS and Termux have not been tried.
set -eu
source=$(cd "$(dirname "$0")/.." && pwd)
target=${FRONTRUNNER_CLIENT:-$HOME/.frontrunner-client}
case $target in
    /*) ;;
    *) target=$PWD/$target ;;
esac
python=${PYTHON:-python3}
options=

if [ -n "${TERMUX_VERSION:-}" ]; then
    # No wheels are published for Android: NumPy comes as a package, pyopencl is built against Termux's loader.
    pkg install -y python python-numpy clang cmake ninja ocl-icd opencl-headers opencl-vendor-driver || {
        echo "pkg could not install what is needed: run 'pkg update' and start again" >&2
        exit 3
    }
    options=--system-site-packages
fi
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "Python 3.11 or newer is needed, $python is not: PYTHON=/path/to/python3.12 sh $0" >&2
    exit 3
fi
"$python" -m venv $options "$target" || {
    echo "$python has no venv module (on Debian and Ubuntu: apt install python3-venv)" >&2
    exit 3
}
install() {
    "$target/bin/python" -m pip install --quiet --disable-pip-version-check "$source[$1]"
}
# Where pyopencl has no wheel, pip builds it, for which a compiler and OpenCL's headers are needed.
install opencl,wasm || {
    echo "pip could not install OpenCL: the lines above say why. Installing WebAssembly alone." >&2
    install wasm || {
        echo "pip could not install the client: the lines above say why" >&2
        exit 3
    }
}
echo "Installed. To take part:"
echo "  $target/bin/python -m client_kit run --server https://ADDRESS"
if [ -e /vendor/lib64/libOpenCL_adreno.so ] || [ -e /vendor/lib64/libCB.so ]; then
    echo "This is an Adreno: put LD_LIBRARY_PATH=/vendor/lib64:${PREFIX:-/usr}/lib before that command."
    export LD_LIBRARY_PATH="/vendor/lib64:${PREFIX:-/usr}/lib"
fi
cd "$HOME"
exec "$target/bin/python" -m client_kit doctor
