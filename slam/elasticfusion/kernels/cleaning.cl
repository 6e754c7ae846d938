// What leaves the map: doubled surfels, those seen through, and those that never became stable (Keller et al. 2013,
// section 4.3; Whelan et al. 2015, section 3.1).
#include "arithmetic.h"
#include "shape.h"
#include "surfels.h"
#include "frame.h"

// Checks the surfel that the index map holds at each pixel against its neighbours; 1 where it must be removed.
// A double: of 16 samples at half-pixel steps, of which the middle pixel has four, those beside it two and the corners
// one, more than `doubles` are older stable surfels close behind it.
// Seen through: at least `fewest` of the nine pixels are measured, and all of these lie far behind it. The map behind a
// surfel is not evidence: the index map does not hold hidden surfels.
kernel void mark_for_removal(global const float *restrict raw, int width, int height, global const int *restrict ids,
                             global const float4 *restrict position_confidence,
                             global const float4 *restrict normal_radius, global const int *restrict first_seen,
                             global const int *restrict last_seen, global const Frame *restrict frame, float threshold,
                             float close, float reach, int doubles, float far, int fewest,
                             global uchar *restrict marked)
{
    const int tick = frame->tick;
    EACH_PIXEL(x, y, width, height)
    {
        const int i = y * width + x, id = ids[i];
        int older = 0, behind = 0, not_behind = 0;
        if (id >= 0 && x > 0 && y > 0 && x < width - 1 && y < height - 1) {
            const float3 p = to_camera(frame->pose, position_confidence[id].xyz);
            const int birth = first_seen[id];
            const float across = reach * normal_radius[id].w;
            for (int dy = -1; dy <= 1; ++dy)
                for (int dx = -1; dx <= 1; ++dx) {
                    const int m = i + dy * width + dx, other = ids[m];
                    behind += raw[m] > p.z + far;
                    not_behind += (raw[m] > 0.0f) & (raw[m] <= p.z + far);
                    if (other < 0 || other == id || !(position_confidence[other].w >= threshold) ||
                        first_seen[other] >= birth)
                        continue;
                    const float3 q = to_camera(frame->pose, position_confidence[other].xyz);
                    const float depth = q.z - p.z, side_x = q.x - p.x, side_y = q.y - p.y;
                    if (depth > 0.0f && depth < close && side_x * side_x + side_y * side_y < across * across)
                        older += (2 - dx * dx) * (2 - dy * dy);
                }
            if (last_seen[id] == tick)
                behind = 0;
        }
        marked[i] = (older > doubles) | ((behind >= fewest) & (not_behind == 0));
    }
}

// Removes the surfels that were marked, and counts them.
kernel void remove_marked(int width, int height, global const int *restrict ids, global const uchar *restrict marked,
                          global float4 *restrict position_confidence, global int *restrict removed)
{
    EACH_PIXEL(x, y, width, height)
    {
        if (marked[y * width + x]) {
            position_confidence[ids[y * width + x]].w = 0.0f;
            atomic_inc(removed);
        }
    }
}

// Removes unstable surfels that were last seen from tick `from` to tick `to`, and counts them.
kernel void remove_unstable(int count, global const int *restrict last_seen, int from, int to, float threshold,
                            global float4 *restrict position_confidence, global int *restrict removed)
{
    EACH_SURFEL(i, count)
    {
        if (last_seen[i] >= from && last_seen[i] <= to && position_confidence[i].w > 0.0f &&
            position_confidence[i].w < threshold) {
            position_confidence[i].w = 0.0f;
            atomic_inc(removed);
        }
    }
}
