// How far the volume can be seen in a frame: no voxel lies deeper than the largest depth of the image.
#include "arithmetic.h"

// The largest depth of each row. One work-item per row.
// Rows: also that of each tile of TILE x TILE pixels, by the first row of each.
kernel void farthest_of_rows(global const float *restrict metres, int width, int height,
                             global float *restrict row_farthest
#ifndef PIXELS
                             ,
                             global float *restrict tile_farthest
#endif
)
{
    const int y = get_global_id(0);
    if (y >= height)
        return;
    float farthest = 0.0f;
    for (int x = 0; x < width; ++x)
        farthest = larger(farthest, metres[y * width + x]);
    row_farthest[y] = farthest;
#ifndef PIXELS
    if (y % TILE != 0)
        return;
    const int columns = (width + TILE - 1) / TILE, end = bounded(y + TILE, 0, height);
    for (int column = 0; column < columns; ++column) {
        const int right = bounded((column + 1) * TILE, 0, width);
        float in_tile = 0.0f;
        for (int row = y; row < end; ++row)
            for (int x = column * TILE; x < right; ++x)
                in_tile = larger(in_tile, metres[row * width + x]);
        tile_farthest[y / TILE * columns + column] = in_tile;
    }
#endif
}

// The largest of the rows. Rows: one work-item. Pixels: one group.
#ifdef PIXELS
__attribute__((reqd_work_group_size(SUM_GROUP, 1, 1)))
#endif
kernel void farthest_depth(global const float *restrict row_farthest, int height, global State *restrict state)
{
    float farthest = 0.0f;
    for (int y = get_local_id(0); y < height; y += get_local_size(0))
        farthest = larger(farthest, row_farthest[y]);
#ifdef PIXELS
    local float lane[SUM_GROUP];
    const int me = get_local_id(0);
    lane[me] = farthest;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (me > 0)
        return;
    for (int other = 1; other < SUM_GROUP; ++other)
        farthest = larger(farthest, lane[other]);
#endif
    state->farthest = farthest;
}
