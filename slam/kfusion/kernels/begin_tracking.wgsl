// Remembers where the frame started, and which pixels the model belongs to, which was seen from there: intrinsics times
// the inverse of the pose. One invocation.
#include "poses.wgsl"

@compute @workgroup_size(1)
fn begin_tracking() {
    let camera = parameters.camera;
    let pose = pose_of(state.pose);
    let intrinsics = mat3x3f(camera.x, 0.0, 0.0, 0.0, camera.y, 0.0, camera.z, camera.w, 1.0);
    let back = transpose(mat3x3f(pose[0], pose[1], pose[2]));
    let translation = -rotate_back(pose, pose[3]);
    state.previous = state.pose;
    state.view = rows_of(mat4x3f(
        intrinsics * back[0],
        intrinsics * back[1],
        intrinsics * back[2],
        intrinsics * translation,
    ));
}
