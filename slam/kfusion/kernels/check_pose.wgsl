// Keeps the new pose when the residual is small, enough of the level solved last took part, and the camera can have moved
// so; otherwise goes back to where the frame started. `refusal` names the rule that refused it, 0 where none did.
// `max_translation` (m) and `max_rotation` (rad) are for one check, and grow with the checks missed. A motion beyond
// `near_motion` (m + rad) needs the share `far_inliers` and the part `kept_inliers` of the share at the last check that
// passed. For `recovery` checks after a refusal the view may be another one: instead of that part, the pixels that see the
// model must agree with it by `kept_agreement` of what they did then, and the share is asked of the second attempt only,
// which no prior guides. The camera may not leave the volume. Written so that NaN fails. One invocation.
#include "conditions.wgsl"
#include "turning.wgsl"

fn in_volume(position: vec3f) -> bool {
    return all(position >= vec3f(0.0)) && all(position <= vec3f(parameters.volume_size));
}

@compute @workgroup_size(1)
fn check_pose() {
    if (!is_wanted()) {
        return;
    }
    let after = pose_of(state.pose);
    let before = pose_of(state.previous);
    let translation = length(after[3] - before[3]);
    let turn = rotation_between(before, after);
    let checks = f32(state.misses + 1);
    let inliers = state.inliers / f32(parameters.pixels);
    let agreement = state.inliers / max(state.overlap, 1.0);
    var enough = inliers >= max(parameters.far_inliers, parameters.kept_inliers * state.last_inliers);
    if (state.recovering != 0) {
        enough = agreement >= parameters.kept_agreement * state.last_agreement
            && (state.retrying == 0 || inliers >= parameters.far_inliers);
    }
    var refusal = 0;
    if (!(inliers >= parameters.min_inliers)) {
        refusal = REFUSED_INLIERS;
    } else if (!(sqrt(state.squared_error / state.inliers) <= parameters.max_residual)) {
        refusal = REFUSED_RESIDUAL;
    } else if (!(translation <= parameters.max_translation * checks)) {
        refusal = REFUSED_TRANSLATION;
    } else if (!(turn.angle <= parameters.max_rotation * checks)) {
        refusal = REFUSED_ROTATION;
    } else if (translation + turn.angle > parameters.near_motion && !enough) {
        refusal = REFUSED_FAR_MOTION;
    } else if (!in_volume(after[3]) && in_volume(before[3])) {
        refusal = REFUSED_OUTSIDE;
    }
    state.refusal = refusal;
    state.tracked = select(0, 1, refusal == 0);
    state.translation = translation;
    state.rotation = turn.angle;
    if (refusal != 0) {
        state.misses += 1;
        state.recovering = parameters.recovery;
        state.pose = state.previous;
        return;
    }
    let turn_of_check = turn.vector / checks;
    state.turn = array<f32, 3>(turn_of_check.x, turn_of_check.y, turn_of_check.z);
    state.last_inliers = inliers;
    state.last_agreement = agreement;
    state.misses = 0;
    state.recovering = max(state.recovering - 1, 0);
}
