// After begin_tracking, in a frame before which some were left out: ICP starts where the motion before them leads. While
// the camera recovers, its turn went on during the frames left out before the pose was lost, too. One invocation.
#include "turning.wgsl"

@compute @workgroup_size(1)
fn predict() {
    state.left_out = state.skip;
    state.skip = 0;
    state.elapsed += state.left_out + 1;
    if (state.recovering != 0 && state.misses < parameters.most_extrapolated) {
        let unseen = f32(state.elapsed - (state.misses + 1));
        state.pose = rows_of(turned_by(unseen * vec3f(state.turn[0], state.turn[1], state.turn[2]), pose_of(state.pose)));
    } else if (state.recovering == 0 && state.left_out != 0) {
        for (var i = 0; i < 12; i++) {
            state.pose[i] = state.ahead[12 * state.left_out + i];
        }
    }
    state.start = state.pose;
}
