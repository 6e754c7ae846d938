// How far the volume can be seen in a frame.
#include "arithmetic.h"
#include "state.h"

// The largest depth of each row, and then of the image: no voxel lies deeper. One work-item per row, then one.
kernel void farthest_of_rows(global const float *restrict metres, int width, global float *restrict row_farthest)
{
    const int y = get_global_id(0);
    float farthest = 0.0f;
    for (int x = 0; x < width; ++x)
        farthest = larger(farthest, metres[y * width + x]);
    row_farthest[y] = farthest;
}

kernel void farthest_depth(global const float *restrict row_farthest, int height, global State *restrict state)
{
    float farthest = 0.0f;
    for (int y = 0; y < height; ++y)
        farthest = larger(farthest, row_farthest[y]);
    state->farthest = farthest;
}
