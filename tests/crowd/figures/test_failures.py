"""What the public reads of a client's free text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.results.reading.public_texts import SENTENCES, public_failure, public_os_version
from crowd.simulation import sessions


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", ""),
        ("  ", ""),
        ("tracking lost in 7 of 8 frames", "the camera was lost in too many frames"),
        (sessions.LOST, "the camera was lost in too many frames"),
        ("the trajectory is not finite", "the trajectory is not finite"),
        (
            "DeviceMemoryError: volume_resolution=512 needs one buffer of 512 MiB, 'Mali' allows at most "
            "384 MiB",
            "the device's buffers are too small",
        ),
        (
            "the volume needs 512 MiB, which 'Mali' refused: MEM_OBJECT_ALLOCATION_FAILURE",
            "out of memory",
        ),
        ("out of memory", "out of memory"),
        ("MemoryError: std::bad_alloc", "out of memory"),
        ("killed by SIGKILL (as the system does when memory runs out): ", "out of memory"),
        ("LogicError: clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES", "out of memory"),
        ("MapFullError: 5000 surfels in a map for 4000: raise surfel_capacity", "the map is full"),
        (
            "RuntimeError: clBuildProgram failed: BUILD_PROGRAM_FAILURE",
            "the driver could not compile the program",
        ),
        (sessions.REFUSED, "the driver could not compile the program"),
        ("DEVICE_NOT_AVAILABLE", "the device was lost"),
        ("no answer from the device within 180 s", "the device did not answer in time"),
        ("no result after 60 s", "the device did not answer in time"),
        ("KeyboardInterrupt", "the run was interrupted"),
        (
            "ConfigurationError: compute_size_ratio=7: must be at least 1",
            "the configuration is not valid here",
        ),
        ("killed by SIGSEGV: ", "the program ended unexpectedly"),
        ("exit code 3: ", "the program ended unexpectedly"),
        ("LogicError: clSetKernelArg failed: INVALID_VALUE", "the driver reported an error"),
        ("visit my site", "other failure"),
    ],
)
def test_a_failure_is_one_of_a_few_sentences(text: str, sentence: str) -> None:
    assert public_failure(text) == sentence


@given(st.text(max_size=500))
def test_no_text_of_a_client_is_a_public_failure(text: str) -> None:
    assert public_failure(text) in SENTENCES


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("16", "16"),
        ("24.04", "24.04"),
        ("10.0.26100", "10.0.26100"),
        ("15.1 (24B83)", "15.1"),
        ("22.04.5 LTS (Jammy Jellyfish)", "22.04.5"),
        ("rolling", "rolling"),
        ("8.1.0-visit", "8.1.0"),
        ("12visit", ""),
        ("visit my site", ""),
        ("1234567890123", ""),
        ("", ""),
    ],
)
def test_a_version_of_a_system_is_a_number(text: str, version: str) -> None:
    assert public_os_version(text) == version
