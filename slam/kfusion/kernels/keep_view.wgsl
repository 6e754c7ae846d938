// After a raycast: which pixels the model belongs to, which is seen from here: intrinsics times the inverse of the pose.
// One invocation.
#include "poses.wgsl"

@compute @workgroup_size(1)
fn keep_view() {
    let camera = parameters.camera;
    let pose = pose_of(state.pose);
    let intrinsics = mat3x3f(camera.x, 0.0, 0.0, 0.0, camera.y, 0.0, camera.z, camera.w, 1.0);
    let back = transpose(mat3x3f(pose[0], pose[1], pose[2]));
    state.view = rows_of(mat4x3f(
        intrinsics * back[0],
        intrinsics * back[1],
        intrinsics * back[2],
        intrinsics * -rotate_back(pose, pose[3]),
    ));
}
