// Closing the gaps that removed surfels leave, without changing the order of the others.
#include "surfels.h"

// How many surfels of each run are left. One work-item per run.
kernel void count_living(int count, global const float4 *restrict place, global int *restrict living)
{
    const int run = get_global_id(0);
    const int end = (run + 1) * RUN < count ? (run + 1) * RUN : count;
    int total = 0;
    for (int i = run * RUN; i < end; ++i)
        total += place[i].w > 0.0f;
    living[run] = total;
}

// The living surfels of a stretch of runs, one behind the other; `before` says how many live in all earlier runs.
// One work-item per run, from `first_run` on.
kernel void gather_living(int count, int first_run, global const int *restrict before,
                          global const float4 *restrict place, global const float4 *restrict face,
                          global const uint *restrict colour, global const int *restrict born,
                          global const int *restrict seen, global float4 *restrict gathered_place,
                          global float4 *restrict gathered_face, global uint *restrict gathered_colour,
                          global int *restrict gathered_born, global int *restrict gathered_seen)
{
    const int run = first_run + get_global_id(0);
    const int end = (run + 1) * RUN < count ? (run + 1) * RUN : count;
    int to = before[run] - before[first_run];
    for (int i = run * RUN; i < end; ++i) {
        if (!(place[i].w > 0.0f))
            continue;
        gathered_place[to] = place[i];
        gathered_face[to] = face[i];
        gathered_colour[to] = colour[i];
        gathered_born[to] = born[i];
        gathered_seen[to] = seen[i];
        ++to;
    }
}
