// What leaves the map: doubled surfels, those seen through, and those that never became stable (Keller et al. 2013,
// section 4.3; Whelan et al. 2015, section 3.1).
#include "arithmetic.h"
#include "shape.h"
#include "surfels.h"
#include "frame.h"

// Judges the surfel that the index map holds at each pixel by those around it, sampled at half-pixel steps: 16 samples,
// of which the middle pixel has four, those beside it two and the corners one. A double has more than `doubles` samples
// of older stable surfels close behind it; one is seen through when it faces the camera and more than `seen_through`
// samples are stable surfels farther behind that this frame measured, while it was not. 1 where the surfel has to go.
kernel void judge(int width, int height, global const int *restrict ids, global const float4 *restrict place,
                  global const float4 *restrict face, global const int *restrict born, global const int *restrict seen,
                  global const Frame *restrict frame, float threshold, float close, float reach, float facing,
                  int doubles, int seen_through, global uchar *restrict condemned)
{
    const int tick = frame->tick;
    EACH_PIXEL(x, y, width, height)
    {
        const int i = y * width + x, id = ids[i];
        int older = 0, farther = 0;
        if (id >= 0 && x > 0 && y > 0 && x < width - 1 && y < height - 1) {
            const float3 p = to_camera(frame->pose, place[id].xyz);
            const float4 n = face[id];
            const float normal_z = turned_to_camera(frame->pose, n.xyz).z;
            const int faces = magnitude(normal_z) > facing && seen[id] < tick;
            const int birth = born[id];
            const float across = reach * n.w;
            for (int dy = -1; dy <= 1; ++dy)
                for (int dx = -1; dx <= 1; ++dx) {
                    const int other = ids[i + dy * width + dx];
                    if (other < 0 || other == id || !(place[other].w >= threshold))
                        continue;
                    const float3 q = to_camera(frame->pose, place[other].xyz);
                    const float behind = q.z - p.z, side_x = q.x - p.x, side_y = q.y - p.y;
                    const int samples = (2 - dx * dx) * (2 - dy * dy);
                    if (behind > 0.0f && behind < close && born[other] < birth &&
                        side_x * side_x + side_y * side_y < across * across)
                        older += samples;
                    if (behind > close && faces && seen[other] == tick)
                        farther += samples;
                }
        }
        condemned[i] = (older > doubles) | (farther > seen_through);
    }
}

// Removes the surfels that were condemned, and counts them.
kernel void remove_condemned(int width, int height, global const int *restrict ids,
                             global const uchar *restrict condemned, global float4 *restrict place,
                             global int *restrict removed)
{
    EACH_PIXEL(x, y, width, height)
    {
        if (condemned[y * width + x]) {
            place[ids[y * width + x]].w = 0.0f;
            atomic_inc(removed);
        }
    }
}

// Removes unstable surfels that were last seen from tick `from` to tick `to`, and counts them.
kernel void remove_unstable(int count, global const int *restrict seen, int from, int to, float threshold,
                            global float4 *restrict place, global int *restrict removed)
{
    EACH_SURFEL(i, count)
    {
        if (seen[i] >= from && seen[i] <= to && place[i].w > 0.0f && place[i].w < threshold) {
            place[i].w = 0.0f;
            atomic_inc(removed);
        }
    }
}
