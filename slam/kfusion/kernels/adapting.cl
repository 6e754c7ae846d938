// A configuration that adapts: how many frames may be left out, and whether the next one is fused.
#include "arithmetic.h"
#include "least_squares.h"
#include "motion.h"
#include "turning.h"

INLINE float distance_between(global const float *from, global const float *to)
{
    const float x = to[3] - from[3], y = to[7] - from[7], z = to[11] - from[11];
    return sqrt(x * x + y * y + z * z);
}

// After begin_tracking, in a frame before which some were left out: ICP starts where the motion before them leads. While
// the camera recovers, its turn went on during the frames left out before the pose was lost, too.
kernel void predict(int most_extrapolated, global State *state)
{
    state->left_out = state->skip;
    state->skip = 0;
    state->elapsed += state->left_out + 1;
    if (state->recovering && state->misses < most_extrapolated) {
        const float unseen = state->elapsed - (state->misses + 1);
        turn_camera(unseen * state->turn[0], unseen * state->turn[1], unseen * state->turn[2], state->pose);
    } else if (!state->recovering && state->left_out) {
        for (int i = 0; i < 12; ++i)
            state->pose[i] = state->ahead[12 * state->left_out + i];
    }
    for (int i = 0; i < 12; ++i)
        state->start[i] = state->pose[i];
}

// After the check of the pose. Frames are left out while the share of inliers stays `kept_inliers` of its slowly decaying
// maximum, and the motion until the frame after next that is tracked, which gains speed as it did in the last frames, stays
// below `skip_translation` (m) and `skip_rotation` (rad). Where a frame lies farther than that from where it was expected, none are left out for
// `cautious` tracked frames. The next tracked frame is fused where it is expected farther than `integrate_translation` or
// `integrate_rotation` from where one was fused last, and during the first `early` ones.
kernel void adapt(int skip_limit, float skip_translation, float skip_rotation, float integrate_translation,
                  float integrate_rotation, float kept_inliers, float decay, int cautious, int early, global State *state)
{
    if (!state->tracked) {
        state->fusing = 1;
        return;
    }
    float turn[3], other[3];
    const float frames = state->elapsed;
    const float rotation = rotation_between(state->previous, state->pose, turn) / frames;
    const float translation = distance_between(state->previous, state->pose) / frames;
    const int astray = state->left_out && (distance_between(state->start, state->pose) > skip_translation ||
                                           rotation_between(state->start, state->pose, other) > skip_rotation);
    float push = 0, twist = 0;
    for (int i = 0; i < 3; ++i) {
        const float velocity = (state->pose[4 * i + 3] - state->previous[4 * i + 3]) / frames;
        push += (velocity - state->velocity[i]) * (velocity - state->velocity[i]);
        twist += (turn[i] / frames - state->last_turn[i]) * (turn[i] / frames - state->last_turn[i]);
        state->velocity[i] = velocity;
        state->turn[i] = state->last_turn[i] = turn[i] / frames;
    }
    push = sqrt(push) / frames;
    twist = sqrt(twist) / frames;
    state->elapsed = 0;
    state->caution = astray ? cautious : state->caution - (state->caution > 0);
    state->most_inliers = larger(state->last_inliers, decay * state->most_inliers);
    if (state->fusing)
        for (int i = 0; i < 12; ++i)
            state->fused[i] = state->pose[i];

    // The first tracked frame knows only how far the camera moved in all frames before it.
    const int still = state->adapted && !state->caution && !state->recovering &&
                      state->last_inliers >= kept_inliers * state->most_inliers;
    for (int skip = 1; still && skip <= skip_limit; ++skip) {
        const float until = skip + 2;
        if (until * (translation + 0.5f * push * until) < skip_translation &&
            until * (rotation + 0.5f * twist * until) < skip_rotation)
            state->skip = skip;
    }
    for (int frame = 0; frame <= state->skip; ++frame) {
        global float *ahead = state->ahead + 12 * frame;
        const float passed = frame + 1;
        for (int i = 0; i < 12; ++i)
            ahead[i] = state->pose[i];
        turn_camera(passed * state->turn[0], passed * state->turn[1], passed * state->turn[2], ahead);
        for (int i = 0; i < 3; ++i)
            ahead[4 * i + 3] += passed * state->velocity[i];
    }
    global const float *next = state->ahead + 12 * state->skip;
    state->fusing = state->adapted < early || state->recovering ||
                    distance_between(state->fused, next) > integrate_translation ||
                    rotation_between(state->fused, next, other) > integrate_rotation;
    state->adapted += state->adapted < early;
}
