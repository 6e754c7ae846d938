"""The protocol of a measurement: which frames count, and which trajectories are valid."""

from typing import Final

FIRST_COUNTED_FRAME = 10  # the first frames fill the model and the caches
FIRST_STOP = 25  # frames after which a run may end early: 15 counted ones give the time
MOST_CHANGE = 0.05  # by how much the mean time of a whole run may be below that at FIRST_STOP
# Of the counted frames, seconds: the mean, the 95th percentile and the largest.
RUNTIMES = ("runtime", "runtime_p95", "runtime_max")
VALID_BELOW = 0.05  # metres of maximal trajectory error
ERROR_ROUNDING = 1e-4  # metres: by so much may a client round its errors and its deviation
# A run that has lost the camera in more of its frames than this has failed, however fast it was.
MOST_LOST = 0.5
LEAST_MATCHED = 0.8  # share of a run's frames that need a true pose for its trajectory to count
MAX_DRIFT = 1.15  # later repeats over earlier ones: pages point out more, and such a device gets no probes
DECODED_AHEAD = 100  # frames that are decoded before they are measured: 61 MB of depth at 640x480
VERSION = 2  # of the protocol that clients measure by
PAIRS = 4  # of default and best in a session
PROBE_PAIRS = 2  # of the default and each configuration that a device is asked for besides
LEAST_PAIRS = 3  # for an interval: two pairs give a uselessly wide one
# 20,000 frames a second: launching the kernels of a frame already takes longer.
SHORTEST_FRAME_US = 50.0
# A configuration that leaves out frames may leave out another share than its reference, by so much.
SKIPPED_TOLERANCE = 0.10
# Work between frames takes so much of each core besides: decoding, sampling, messages.
BETWEEN_FRAMES_US = 10_000
# Stages and frames are timed separately: they may differ by this factor and so much a frame.
STAGE_TOLERANCE, STAGE_SLACK_US = 1.05, 50.0
NO_STAGES: Final = "none"  # the `stage_clock` where nothing measured the stages
MOST_RUNS = 50  # of a session, and of a submission
