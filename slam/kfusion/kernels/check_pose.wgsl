// Keeps the new pose when the residual is small, enough of the level solved last took part, and the camera can have moved
// so; otherwise goes back to where the frame started. `max_translation` (m) and `max_rotation` (rad) are for one check, and
// grow with the checks missed. A motion beyond `near_motion` (m + rad) needs the share `far_inliers` and, unless checks were
// missed, the part `kept_inliers` of the share at the last check that passed. The camera may not leave the volume.
// Frames without any inlier are lost. One invocation.

fn in_volume(position: vec3f) -> bool {
    return all(position >= vec3f(0.0)) && all(position <= vec3f(parameters.volume_size));
}

@compute @workgroup_size(1)
fn check_pose() {
    let after = vec3f(state.pose[3], state.pose[7], state.pose[11]);
    let before = vec3f(state.previous[3], state.previous[7], state.previous[11]);
    let translation = length(after - before);
    var trace = 0.0;
    for (var row = 0; row < 3; row++) {
        for (var column = 0; column < 3; column++) {
            trace += state.pose[4 * row + column] * state.previous[4 * row + column];
        }
    }
    let rotation = acos(clamp(0.5 * (trace - 1.0), -1.0, 1.0));
    let checks = f32(state.misses + 1);
    let share = state.inliers / f32(parameters.pixels);
    let kept = select(parameters.kept_inliers * state.last_inliers, 0.0, state.misses > 0);
    let far = max(parameters.far_inliers, kept);
    let needed = select(parameters.min_inliers, far, translation + rotation > parameters.near_motion);
    var good = false;
    if (state.inliers > 0.0) {
        good = sqrt(state.squared_error / state.inliers) <= parameters.max_residual
            && share >= needed
            && translation <= parameters.max_translation * checks
            && rotation <= parameters.max_rotation * checks
            && (in_volume(after) || !in_volume(before));
    }
    state.tracked = select(0, 1, good);
    state.misses = select(state.misses + 1, 0, good);
    if (good) {
        state.last_inliers = share;
    } else {
        state.pose = state.previous;
    }
}
