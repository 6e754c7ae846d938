"""Public replacements of free text from clients: fixed sentences, never the text itself."""

import re

OTHER = "other failure"
# Why a run failed, with a pattern for the client's text. The first match wins. Clients send the errors of
# `slam`, of OpenCL drivers and of the operating system.
FAILURES = tuple(
    (re.compile(pattern, re.IGNORECASE), sentence)
    for sentence, pattern in (
        ("the camera was lost in too many frames", r"tracking( was)? lost|lost (the )?(tracking|camera)"),
        ("the trajectory is not finite", r"not finite|nothing finite|\bnan\b"),
        ("the device's buffers are too small", r"needs one buffer of|invalid.buffer.size"),
        ("the map is full", r"exceed surfel_capacity|surfels in a map"),
        (
            "the driver could not compile the program",
            r"build.(program.)?failure|compile.program|failed to build|refused to build",
        ),
        (
            "out of memory",
            r"out of (device |host )?memory|out.of.resources|out.of.host|object.allocation|cannot allocate|"
            r"memoryerror|memory runs out|mib, which|bad_alloc|sigkill",
        ),
        (
            "the device was lost",
            r"device.(was.)?(lost|removed)|device.not.(found|available)|no opencl device",
        ),
        ("the device did not answer in time", r"no answer|no result after|timed? ?out|watchdog|too long"),
        ("the run was interrupted", r"interrupt|sigint|sigterm|cancell?ed"),
        (
            "the configuration is not valid here",
            r"configurationerror|must be (at least|a|above|true)|unknown parameter",
        ),
        (
            "the program ended unexpectedly",
            r"killed by|exit code|no process can be started|sigsegv|sigabrt|sigbus|sigill",
        ),
        (
            "the driver reported an error",
            r"cl_|clerror|opencl|invalid.(value|work|kernel|command|operation)|logicerror|runtimeerror",
        ),
    )
)
SENTENCES = frozenset({sentence for _, sentence in FAILURES} | {"", OTHER})
# "16", "24.04", "10.0.26100", "13.6.1", "15 (25A354)": a number, perhaps followed by a build.
OS_VERSION = re.compile(r"v?(\d{1,5}(?:\.\d{1,5}){0,3})(?![\w.])", re.IGNORECASE | re.ASCII)


def public_failure(text: str) -> str:
    """One of SENTENCES for `text`: empty for an empty text, OTHER if no pattern matches."""
    if not text.strip():
        return ""
    return next((sentence for pattern, sentence in FAILURES if pattern.search(text)), OTHER)


def public_os_version(text: str) -> str:
    """The version number at the start of `text`: digits and dots; empty for anything else.

    Names of rolling distributions, such as "rolling" and Debian's "sid" and "testing", are kept.
    """
    line = text.strip()
    if line.casefold() in {"rolling", "sid", "testing", "unstable"}:
        return line.casefold()
    match = OS_VERSION.match(line)
    return match[1] if match else ""
