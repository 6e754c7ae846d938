// `begin_tracking` without the view, which stays. One invocation.
#include "turning.wgsl"

@compute @workgroup_size(1)
fn begin_at_view() {
    let pose = pose_of(state.pose);
    state.previous = state.pose;
    state.retrying = 0;
    if (state.recovering != 0 && state.misses < parameters.most_extrapolated) {
        let turn = f32(state.misses + 1) * vec3f(state.turn[0], state.turn[1], state.turn[2]);
        state.pose = rows_of(turned_by(turn, pose));
    }
    state.start = state.pose;
}
