// Remembers where the frame started, and which pixels the model belongs to, which was seen from there: intrinsics times
// the inverse of the pose. While the camera recovers, ICP starts where its last turn leads, believed to go on for
// `most_extrapolated` checks. One invocation.
#include "turning.wgsl"

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
    state.retrying = 0;
    if (state.recovering != 0 && state.misses < parameters.most_extrapolated) {
        let turn = f32(state.misses + 1) * vec3f(state.turn[0], state.turn[1], state.turn[2]);
        state.pose = rows_of(turned_by(turn, pose));
    }
    state.start = state.pose;
}
