// Keeps the new pose when the residual is small and enough of the level solved last took part; otherwise goes back to
// where the frame started. Frames without any inlier are lost. One invocation.

@compute @workgroup_size(1)
fn check_pose() {
    let inliers = state.inliers;
    var good = false;
    if (inliers > 0.0) {
        good = sqrt(state.squared_error / inliers) <= parameters.max_residual
            && inliers / f32(parameters.pixels) >= parameters.min_inliers;
    }
    state.tracked = select(0, 1, good);
    if (!good) {
        state.pose = state.previous;
    }
}
