"""Open3D's dense SLAM over depth images, as a process of its own: runs in an environment that has Open3D.

Reads an .npz (depth (n, h, w) uint16 millimetres, intrinsics (fx, fy, cx, cy), volume_size, frames) and
prints JSON: CPU and wall milliseconds a frame from frame 10 on, and the estimated poses.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
import open3d as o3d

ITERATIONS = [10, 5, 3]  # Open3D's three levels, finest first
FIRST_COUNTED_FRAME = 10


def main(path: str) -> None:
    data = np.load(path)
    depth, (fx, fy, cx, cy) = data["depth"], data["intrinsics"]
    count, height, width = depth.shape
    intrinsic = o3d.core.Tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], o3d.core.Dtype.Float64)
    device = o3d.core.Device("CPU:0")
    start = o3d.core.Tensor(np.eye(4))
    model = o3d.t.pipelines.slam.Model(float(data["volume_size"]) / 256, 16, 10000, start, device)
    input_frame = o3d.t.pipelines.slam.Frame(height, width, intrinsic, device)
    raycast_frame = o3d.t.pipelines.slam.Frame(height, width, intrinsic, device)
    colour = o3d.t.geometry.Image(o3d.core.Tensor(np.zeros((height, width, 3), np.uint8)))
    criteria = [o3d.t.pipelines.odometry.OdometryConvergenceCriteria(n) for n in reversed(ITERATIONS)]
    pose, poses, wall, cpu = start, [], [], []
    for number in range(count):
        image = o3d.t.geometry.Image(o3d.core.Tensor(depth[number]))
        began, used = time.perf_counter(), time.process_time()
        input_frame.set_data_from_image("depth", image)
        input_frame.set_data_from_image("color", colour)
        if number:
            result = model.track_frame_to_model(
                input_frame, raycast_frame, 1000.0, 4.0, 0.1,
                o3d.t.pipelines.odometry.Method.PointToPlane, criteria,
            )  # fmt: skip
            pose = pose @ result.transformation
        model.update_frame_pose(number, pose)
        model.integrate(input_frame, 1000.0, 4.0)
        model.synthesize_model_frame(raycast_frame, 1000.0, 0.4, 4.0, enable_color=False)
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - used)
        poses.append(pose.numpy().tolist())
    json.dump(
        {
            "version": o3d.__version__,
            "cpu_ms": 1e3 * float(np.mean(cpu[FIRST_COUNTED_FRAME:])),
            "wall_ms": 1e3 * float(np.mean(wall[FIRST_COUNTED_FRAME:])),
            "poses": poses,
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main(sys.argv[1])
