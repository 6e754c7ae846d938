// After begin_tracking, in a frame before which some were left out: ICP starts where the motion before them leads. One
// invocation.

@compute @workgroup_size(1)
fn predict() {
    state.left_out = state.skip;
    state.skip = 0;
    state.elapsed += state.left_out + 1;
    if (state.left_out == 0 || state.recovering != 0) {
        return;
    }
    for (var i = 0; i < 12; i++) {
        state.pose[i] = state.ahead[12 * state.left_out + i];
    }
    state.start = state.pose;
}
