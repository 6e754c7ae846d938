// Begins the frame's second attempt where the first was refused; together they are one check. It starts from the kept pose
// and, after `search_after` failed checks, from there turned by `search_angle` (rad) about eight axes of the image in turn.
// One invocation.
#include "turning.wgsl"

const EIGHTH = 0.78539816f; // of a circle, in radians

@compute @workgroup_size(1)
fn begin_retry() {
    state.retrying = select(0, 1, state.refusal != 0);
    if (state.retrying == 0) {
        return;
    }
    state.misses -= 1;
    if (state.misses < parameters.search_after) {
        return;
    }
    let pose = pose_of(state.pose);
    let direction = EIGHTH * f32(state.misses);
    let axis = cos(direction) * pose[0] + sin(direction) * pose[1];
    state.pose = rows_of(turned_by(parameters.search_angle * axis, pose));
}
