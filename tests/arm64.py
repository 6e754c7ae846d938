"""A Debian for 64-bit ARM, the paper's kind of machine, in a folder. qemu emulates its processor.

The kernel gives its programs to qemu by binfmt_misc, in a user namespace: the machine itself stays as it is.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.wheel import PROJECT

PROGRAMS = ("debootstrap", "dpkg-deb", "qemu-aarch64-static", "unshare")
SUITE, PYTHON = "bookworm", "3.11"
PACKAGES = ("ca-certificates", "pocl-opencl-icd", "python3-venv")
BYTES = 2 * 10**9
HANGS = 3600  # seconds after which an emulated program will not end any more
# How the kernel recognises its programs: the first bytes, and which of their bits count.
HEADER = r"\x7fELF\x02\x01\x01" + r"\x00" * 9 + r"\x02\x00\xb7\x00"
MASK = r"\xff" * 7 + r"\x00" + r"\xff" * 8 + r"\xfe\xff\xff\xff"
NAMESPACES = ("--user", "--map-root-user", "--mount", "--pid", "--fork", "--kill-child")
BINFMT = """
set -e
mount -t binfmt_misc none /proc/sys/fs/binfmt_misc
printf %s "$BINFMT" > /proc/sys/fs/binfmt_misc/register
"""
# The shell stays: the first process of a namespace does not end by a signal of its own, and qemu would wait.
ENTER = f"""{BINFMT}
for folder in dev sys; do mount --rbind /$folder "$DEBIAN/$folder"; done
mount -t proc none "$DEBIAN/proc"
chroot "$DEBIAN" "$@" && exit
"""
# The names of wheels for glibc's versions up to this Debian's.
PLATFORMS = [
    f"--platform={name}_aarch64" for name in ("manylinux2014", *(f"manylinux_2_{n}" for n in range(17, 37)))
]
CLIENT = "/opt/client/bin/python"
# Modules are compiled when they are first imported: pip would compile all of NumPy's.
INSTALL = f"""
set -e
python3 -m venv --without-pip /opt/client
PYTHONPATH=$(echo /usr/share/python-wheels/pip-*.whl) {CLIENT} -m pip install --quiet --no-compile \\
    --no-index --find-links /opt/wheels "frontrunner[opencl,wasm]"
"""


class Debian:
    """The Debian in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, *command: str, **environment: str) -> "subprocess.CompletedProcess[str]":
        """Run one of its programs, with the network of this machine."""
        return _in_namespaces(ENTER, *command, DEBIAN=str(self.folder), HOME="/root", **environment)


def _in_namespaces(script: str, *arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    binfmt = f":arm64:M::{HEADER}:{MASK}:{shutil.which('qemu-aarch64-static')}:OCF"
    own = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8", "BINFMT": binfmt}
    command = ["unshare", *NAMESPACES, "sh", "-c", script, "sh", *arguments]
    return subprocess.run(command, env=own | environment, capture_output=True, text=True, timeout=HANGS)


def skip_without_means(folder: Path) -> None:
    """Skip the test where an emulated Debian cannot be made in `folder`."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}")
    if os.geteuid() != 0:
        pytest.skip("debootstrap needs root")
    if shutil.disk_usage(folder).free < BYTES:
        pytest.skip(f"needs {BYTES / 1e9:.0f} GB in {folder}")
    tried = _in_namespaces(BINFMT)
    if tried.returncode:
        pytest.skip(f"needs binfmt_misc in user namespaces, as of Linux 6.7: {_last_line(tried)}")


def make(folder: Path, wheel: Path) -> Debian:
    """A Debian in `folder`, with PoCL and with the client of `wheel` as CLIENT."""
    kind = ("--arch=arm64", "--variant=minbase", "--foreign", f"--include={','.join(PACKAGES)}")
    _fetch("debootstrap", *kind, SUITE, str(folder))
    # Unpacked is enough: to configure packages takes an emulation minutes.
    for package in (folder / "var/cache/apt/archives").glob("*.deb"):
        subprocess.run(["dpkg-deb", "--extract", package, folder], check=True)
    (folder / "etc/hosts").write_text("127.0.0.1 localhost\n")
    wheels = folder / "opt/wheels"
    made_for = ("--only-binary=:all:", f"--python-version={PYTHON}", *PLATFORMS)
    locked = ("--constraint", str(PROJECT / "requirements.lock"), "numpy", "pyopencl", "wasmtime")
    _fetch(sys.executable, "-m", "pip", "download", "--quiet", "--dest", str(wheels), *made_for, *locked)
    shutil.copy(wheel, wheels)
    debian = Debian(folder)
    installed = debian.run("sh", "-c", INSTALL)
    assert installed.returncode == 0, installed.stderr
    return debian


def _fetch(*command: str) -> None:
    """Run what needs a network; the test is skipped where that fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"{Path(command[0]).name} failed: {_last_line(done)}")


def _last_line(done: "subprocess.CompletedProcess[str]") -> str:
    return (done.stderr or done.stdout).strip().splitlines()[-1]
