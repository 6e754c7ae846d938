// A model whose rays are not cast after every frame: tracking sees it from where they began last.
#include "arithmetic.h"
#include "motion.h"
#include "turning.h"

// After a raycast: which pixels the model belongs to, which is seen from here: intrinsics times the inverse of the pose.
kernel void keep_view(float4 camera, global State *state)
{
    const float t[3] = {state->pose[3], state->pose[7], state->pose[11]};
    for (int column = 0; column < 4; ++column) {
        float inverse[3];
        for (int i = 0; i < 3; ++i)
            inverse[i] = column < 3 ? state->pose[4 * column + i]
                                    : -(state->pose[i] * t[0] + state->pose[4 + i] * t[1] + state->pose[8 + i] * t[2]);
        state->view[column] = camera.x * inverse[0] + camera.z * inverse[2];
        state->view[4 + column] = camera.y * inverse[1] + camera.w * inverse[2];
        state->view[8 + column] = inverse[2];
    }
}

// `begin_tracking` without the view, which stays.
kernel void begin_at_view(int most_extrapolated, global State *state)
{
    for (int i = 0; i < 12; ++i)
        state->previous[i] = state->pose[i];
    state->retrying = 0;
    if (state->recovering && state->misses < most_extrapolated) {
        const float checks = state->misses + 1;
        turn_camera(checks * state->turn[0], checks * state->turn[1], checks * state->turn[2], state->pose);
    }
    for (int i = 0; i < 12; ++i)
        state->start[i] = state->pose[i];
}
