// Closing the gaps that removed surfels leave, without changing the order of the others.
#include "surfels.h"

// How many surfels of each run are left. One work-item per run.
kernel void count_living(int count, global const float4 *restrict position_confidence, global int *restrict living)
{
    const int run = get_global_id(0);
    const int end = (run + 1) * RUN < count ? (run + 1) * RUN : count;
    int total = 0;
    for (int i = run * RUN; i < end; ++i)
        total += position_confidence[i].w > 0.0f;
    living[run] = total;
}

// The living surfels of a stretch of runs, one behind the other; `before` says how many live in all earlier runs.
// One work-item per run, from `first_run` on.
kernel void gather_living(int count, int first_run, global const int *restrict before,
                          global const float4 *restrict position_confidence,
                          global const float4 *restrict normal_radius, global const uint *restrict colour,
                          global const int *restrict first_seen, global const int *restrict last_seen,
                          global float4 *restrict gathered_position_confidence,
                          global float4 *restrict gathered_normal_radius, global uint *restrict gathered_colour,
                          global int *restrict gathered_first_seen,
                          global int *restrict gathered_last_seen)
{
    const int run = first_run + get_global_id(0);
    const int end = (run + 1) * RUN < count ? (run + 1) * RUN : count;
    int to = before[run] - before[first_run];
    for (int i = run * RUN; i < end; ++i) {
        if (!(position_confidence[i].w > 0.0f))
            continue;
        gathered_position_confidence[to] = position_confidence[i];
        gathered_normal_radius[to] = normal_radius[i];
        gathered_colour[to] = colour[i];
        gathered_first_seen[to] = first_seen[i];
        gathered_last_seen[to] = last_seen[i];
        ++to;
    }
}
