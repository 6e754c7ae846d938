"""The camera paths of the synthetic living room: hand-held, or a turn of more than a full circle."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from slam.datasets.synthetic.place import turn

Array = npt.NDArray[np.float64]

SEED = 7
STILL = 0.1  # seconds without any motion: KinectFusion takes frames 0 to 3 for granted
SETTLE = 0.4  # seconds after which the motion has half its size
# Hand-held motion is a sum of slow swings and of a tremor. Swings: amplitude and hertz.
START = np.array([-0.1, -1.4, -1.2])
SWING_POSITION = (((0.22, 0.30), (0.03, 0.85)), ((0.08, 0.37), (0.02, 1.0)), ((0.13, 0.27), (0.02, 0.9)))
SWING_ANGLE = (((7.0, 0.33), (0.8, 0.9)), ((3.0, 0.41), (0.6, 1.1)), ((2.2, 0.36), (0.5, 0.8)))
GAZE = (6.0, -14.0, 0.0)  # degrees of yaw, pitch and roll at rest: a little downwards
TREMOR_HERTZ = (3.1, 4.7, 6.3, 8.9)
TREMOR_POSITION = 0.0005  # metres
TREMOR_ANGLE = 0.06  # degrees
HURRY = 0.025  # seconds by which the swings run ahead and fall behind, twice a second
# The loop: a circle on which the camera looks outwards, with slow swings in height and pitch.
CENTRE = np.array([0.0, -1.35, -0.2])
RADIUS = 0.35
TURNED = 410.0  # degrees from the first frame to the last: the start comes into view again and leaves it
LOOP_PITCH = (-16.0, 4.0, 3)  # degrees: mean, amplitude, waves a turn
LOOP_HEIGHT = (0.08, 2)  # metres, waves a turn


def hand_held(timestamps: Array, seed: int = SEED) -> Array:
    """The poses (n, 4, 4) of a camera that looks at one side of the room from a hand, at some seconds."""
    seconds, started = since_start(timestamps)
    hurried = started * (seconds + HURRY * np.sin(2 * math.pi * 2 * seconds))
    tremor = started[:, None] * get_tremor(seconds, seed)
    position = START + _swing(hurried, SWING_POSITION) + TREMOR_POSITION * tremor[:, :3]
    angles = GAZE + _swing(hurried, SWING_ANGLE) + TREMOR_ANGLE * tremor[:, 3:]
    return to_poses(position, angles)


def loop(timestamps: Array, seed: int = SEED) -> Array:
    """The poses (n, 4, 4) of a camera that turns TURNED degrees on a circle, whatever time that takes.

    It starts and ends slowly, so that the first frames and the last are nearly still.
    """
    seconds, started = since_start(timestamps)
    travelled = np.cumsum(started * since_start(timestamps[-1] + STILL - timestamps)[1])
    progress = travelled / max(float(travelled[-1]), 1e-9)
    turned, wave = TURNED * progress, 2 * math.pi * progress
    yaw = np.radians(turned)
    tremor = started[:, None] * get_tremor(seconds, seed)
    outwards = np.stack([np.sin(yaw), np.zeros(len(yaw)), np.cos(yaw)], axis=1)
    position = CENTRE + RADIUS * outwards + TREMOR_POSITION * tremor[:, :3]
    position[:, 1] += LOOP_HEIGHT[0] * np.sin(LOOP_HEIGHT[1] * wave)
    pitch = LOOP_PITCH[0] + LOOP_PITCH[1] * np.sin(LOOP_PITCH[2] * wave)
    angles = np.stack([turned, pitch, np.zeros(len(yaw))], axis=1) + TREMOR_ANGLE * tremor[:, 3:]
    return to_poses(position, angles)


def since_start(timestamps: Array) -> tuple[Array, Array]:
    """Seconds since the camera began to move, and how far motion has got under way, from 0 to 1."""
    seconds = np.maximum(timestamps - STILL, 0)
    return seconds, seconds**2 / (seconds**2 + SETTLE**2)


def to_poses(position: Array, angles: Array) -> Array:
    """Poses (n, 4, 4), camera to world, of positions (n, 3) in metres and of yaw, pitch, roll in degrees."""
    result = np.tile(np.eye(4), (len(position), 1, 1))
    result[:, :3, 3] = position
    result[:, :3, :3] = [turn(*row) for row in angles]
    return result


def _swing(seconds: Array, axes: tuple[tuple[tuple[float, float], ...], ...]) -> Array:
    return np.stack(
        [
            sum(amplitude * np.sin(2 * math.pi * hertz * seconds) for amplitude, hertz in axis)
            for axis in axes
        ],
        axis=1,
    )


def get_tremor(seconds: Array, seed: int) -> Array:
    """Six unit tremors (n, 6): a few fast sines of random phase each."""
    rng = np.random.default_rng([seed, 2])
    phases = rng.uniform(0, 2 * math.pi, (6, len(TREMOR_HERTZ)))
    waves = np.sin(2 * math.pi * seconds[:, None, None] * np.array(TREMOR_HERTZ) + phases)
    return np.asarray(waves.sum(axis=2))
