// After the check of the pose. Frames are left out while the share of inliers stays `kept_inliers` of its slowly decaying
// maximum, and the motion until the frame after next that is tracked, which gains speed as it did in the last frames, stays
// below `skip_translation` (m) and `skip_rotation` (rad). Where a frame lies farther than that from where it was expected, none are left out for
// `cautious` tracked frames. The next tracked frame is fused where it is expected farther than `integrate_translation` or
// `integrate_rotation` from where one was fused last, and during the first `early` ones. One invocation.
#include "turning.wgsl"

@compute @workgroup_size(1)
fn adapt() {
    if (state.tracked == 0) {
        state.fusing = 1;
        return;
    }
    let pose = pose_of(state.pose);
    let before = pose_of(state.previous);
    let start = pose_of(state.start);
    let frames = f32(state.elapsed);
    let turn = rotation_between(before, pose);
    let turn_a_frame = turn.vector / frames;
    let velocity = (pose[3] - before[3]) / frames;
    let rotation = turn.angle / frames;
    let translation = length(pose[3] - before[3]) / frames;
    let astray = state.left_out != 0 && (length(pose[3] - start[3]) > parameters.skip_translation
        || rotation_between(start, pose).angle > parameters.skip_rotation);
    let last_turn = vec3f(state.last_turn[0], state.last_turn[1], state.last_turn[2]);
    let last_velocity = vec3f(state.velocity[0], state.velocity[1], state.velocity[2]);
    let push = length(velocity - last_velocity) / frames;
    let twist = length(turn_a_frame - last_turn) / frames;
    state.turn = array<f32, 3>(turn_a_frame.x, turn_a_frame.y, turn_a_frame.z);
    state.last_turn = state.turn;
    state.velocity = array<f32, 3>(velocity.x, velocity.y, velocity.z);
    state.elapsed = 0;
    state.caution = select(max(state.caution - 1, 0), parameters.cautious, astray);
    state.most_inliers = max(state.last_inliers, parameters.decay * state.most_inliers);
    if (state.fusing != 0) {
        state.fused = state.pose;
    }

    // The first tracked frame knows only how far the camera moved in all frames before it.
    let still = state.adapted != 0 && state.caution == 0 && state.recovering == 0
        && state.last_inliers >= parameters.kept_inliers * state.most_inliers;
    for (var skip = 1; still && skip <= parameters.skip_limit; skip++) {
        let until = f32(skip + 2);
        if (until * (translation + 0.5 * push * until) < parameters.skip_translation
            && until * (rotation + 0.5 * twist * until) < parameters.skip_rotation) {
            state.skip = skip;
        }
    }
    var next = pose;
    for (var frame = 0; frame <= state.skip; frame++) {
        let passed = f32(frame + 1);
        next = turned_by(passed * turn_a_frame, pose);
        next[3] += passed * velocity;
        let rows = rows_of(next);
        for (var i = 0; i < 12; i++) {
            state.ahead[12 * frame + i] = rows[i];
        }
    }
    let fused = pose_of(state.fused);
    state.fusing = select(0, 1, state.adapted < parameters.early || state.recovering != 0
        || length(next[3] - fused[3]) > parameters.integrate_translation
        || rotation_between(fused, next).angle > parameters.integrate_rotation);
    state.adapted += select(0, 1, state.adapted < parameters.early);
}
