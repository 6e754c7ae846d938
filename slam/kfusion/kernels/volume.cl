// The truncated signed distance function (Newcombe et al. 2011, section 3.3; Curless and Levoy 1996).
// A distance is a signed 16-bit number, SCALE for one truncation distance. Voxel (x, y, z) is centred at (x+.5, y+.5, z+.5).
// Rows: a voxel's word holds its distance in the low half and, for the raycast, that of its neighbour at x + 1 in the high
// half: interpolating along x then takes one load. Weights lie in a plane of their own.
// Pixels: the low half holds SCALE minus the distance, the high half the weight: a word of 0 is empty space, never observed.
// A block's mark says where in it voxels have come near a surface. Rows: bit 0 for anywhere; bit k for the first layers
// towards smaller coordinates, along x (k & 1), y (k & 2) and z (k & 4) together. Pixels: 1 for anywhere, and all else.
#include "arithmetic.h"

#define ANYWHERE 1
#ifdef PIXELS
#define FIRST(k) 1
#else
#define FIRST(k) (1 << (k))
#endif

// Narrows [*first, *last] to the whole numbers x with offset + slope x >= 0, one more at either end.
INLINE void clip(float offset, float slope, float *first, float *last)
{
    const float root = -offset / slope;
    if (slope > 0.0f)
        *first = larger(*first, root - 1.0f);
    else if (slope < 0.0f)
        *last = smaller(*last, root + 1.0f);
    else if (offset < 0.0f)
        *last = -1.0f;
}

// The running mean of a voxel's distance and what is measured for it; (x, y, z) is its centre in the camera's frame.
// Returns whether the voxel was measured at all; *distance and *weight then hold the new values.
INLINE int fuse(int *distance, int *weight, float x, float y, float z, global const float *restrict depth, int width,
                int height, float4 camera, float mu, float max_weight)
{
    const float inverse_z = 1.0f / z;
    const float ray_x = x * inverse_z, ray_y = y * inverse_z;
    const float u = camera.x * ray_x + camera.z + 0.5f, v = camera.y * ray_y + camera.w + 0.5f;
    const float right = width - 1, bottom = height - 1;
    const int visible = (z > 0.0001f) & (u >= 0.0f) & (u <= right) & (v >= 0.0f) & (v <= bottom);
    const float measured = depth[(int)(visible ? v : 0.0f) * width + (int)(visible ? u : 0.0f)];
    const float square = 1.0f + ray_x * ray_x + ray_y * ray_y;
    const float difference = (measured - z) * square * inverse_root(square);
    const int update = visible & (measured > 0.0f) & (difference > -mu);

    const float before = *weight;
    const float observed = smaller(difference * (SCALE / mu), SCALE);
    const float mean = (*distance * before + observed) / (before + 1.0f);
    // Adding 32768.5 makes truncation round to the nearest, also below zero.
    const int rounded = (int)(larger(mean, -SCALE) + 32768.5f) - 32768;
    *distance = update ? rounded : *distance;
    *weight = update ? (int)smaller(before + 1.0f, max_weight) : *weight;
    return update;
}

// The range [*first, *last] of steps along a line of voxels that the camera may see, no deeper than `limit`; *last <
// *first where there is none. The line's first centre is at `base` in the camera's frame, a step adds `slope`.
INLINE void visible_range(float3 base, float3 slope, int steps, int width, int height, float4 camera, float limit,
                          int *first, int *last)
{
    float from = 0.0f, to = steps - 1;
    clip(base.z, slope.z, &from, &to);
    clip(limit - base.z, -slope.z, &from, &to);
    const float left = camera.z + 0.5f, right = camera.z + 0.5f - (width - 1);
    clip(camera.x * base.x + left * base.z, camera.x * slope.x + left * slope.z, &from, &to);
    clip(-camera.x * base.x - right * base.z, -camera.x * slope.x - right * slope.z, &from, &to);
    const float top = camera.w + 0.5f, bottom = camera.w + 0.5f - (height - 1);
    clip(camera.y * base.y + top * base.z, camera.y * slope.y + top * slope.z, &from, &to);
    clip(-camera.y * base.y - bottom * base.z, -camera.y * slope.y - bottom * slope.z, &from, &to);
    *first = from <= to ? (int)from : 0;
    *last = from <= to ? bounded((int)to, 0, steps - 1) : -1;
}

// The centre of voxel (x, y, z) in the camera's frame.
INLINE float3 voxel_to_camera(global const State *restrict state, int x, int y, int z, float voxel_size)
{
    global const float *pose = state->pose;
    const float px = (x + 0.5f) * voxel_size - pose[3];
    const float py = (y + 0.5f) * voxel_size - pose[7];
    const float pz = (z + 0.5f) * voxel_size - pose[11];
    return (float3)(pose[0] * px + pose[4] * py + pose[8] * pz, pose[1] * px + pose[5] * py + pose[9] * pz,
                    pose[2] * px + pose[6] * py + pose[10] * pz);
}

#ifndef PIXELS
#define MOST_BLOCKS 128 // of a row that are tested; those beyond count as not hidden
#define FOREMOST 0.05f  // metres: no block is tested that reaches nearer to the camera
#define MARGIN 1e-4f    // metres, for rounding

// Whether all voxels of a block lie farther than mu behind what is measured around them: `tile_farthest` holds the largest
// depth of each TILE x TILE pixels. (x, y, z): the centre of the block in the camera's frame, `half` its extent from there.
INLINE int is_hidden(float3 centre, float3 half_size, global const float *restrict tile_farthest, int width, int height,
                     float4 camera, float mu)
{
    const float nearest = centre.z - half_size.z, farthest = centre.z + half_size.z;
    if (!(nearest > FOREMOST))
        return 0;
    const float left = centre.x - half_size.x, right = centre.x + half_size.x;
    const float top = centre.y - half_size.y, bottom = centre.y + half_size.y;
    const float u0 = camera.x * (left < 0.0f ? left / nearest : left / farthest) + camera.z;
    const float u1 = camera.x * (right > 0.0f ? right / nearest : right / farthest) + camera.z;
    const float v0 = camera.y * (top < 0.0f ? top / nearest : top / farthest) + camera.w;
    const float v1 = camera.y * (bottom > 0.0f ? bottom / nearest : bottom / farthest) + camera.w;
    const int columns = (width + TILE - 1) / TILE, rows = (height + TILE - 1) / TILE;
    // One pixel more on each side than rounding to the nearest may reach.
    const int first_column = bounded((int)((smaller(u0, u1) - 1.0f) / TILE), 0, columns - 1);
    const int last_column = bounded((int)((larger(u0, u1) + 2.0f) / TILE), 0, columns - 1);
    const int first_row = bounded((int)((smaller(v0, v1) - 1.0f) / TILE), 0, rows - 1);
    const int last_row = bounded((int)((larger(v0, v1) + 2.0f) / TILE), 0, rows - 1);
    float measured = 0.0f;
    for (int row = first_row; row <= last_row; ++row)
        for (int column = first_column; column <= last_column; ++column)
            measured = larger(measured, tile_farthest[row * columns + column]);
    return nearest > measured + mu + MARGIN;
}

// Fuses the voxels `first` to `last` of a row along x, and marks the row's blocks. (x, y, z) of the voxel `first` is
// base + first * slope in the camera's frame.
INLINE void fuse_stretch(global uint *restrict row, global uchar *restrict weights, int resolution, int y, int z,
                         int first, int last, float3 base, float3 slope, global int *restrict marks,
                         global const float *restrict depth, int width, int height, float4 camera, float mu,
                         float max_weight, float near_surface)
{
    const float base_x = base.x, base_y = base.y, base_z = base.z;
    const float slope_x = slope.x, slope_y = slope.y, slope_z = slope.z;
    int changed = 0, near = 0;
    for (int x = first; x <= last; ++x) {
        const uint word = row[x];
        int distance = (short)(word & 0xffff), weight = weights[x];
        const int update = fuse(&distance, &weight, base_x + x * slope_x, base_y + x * slope_y, base_z + x * slope_z,
                                depth, width, height, camera, mu, max_weight);
        row[x] = (word & 0xffff0000) | ((uint)distance & 0xffff);
        weights[x] = weight;
        changed |= update;
        near |= update & (distance < (int)near_surface);
    }
    if (!changed)
        return;
    for (int x = bounded(first - 1, 0, last); x <= bounded(last, 0, resolution - 2); ++x)
        row[x] = (row[x] & 0xffff) | (row[x + 1] << 16);
    if (!near)
        return;
    for (int block = first / BLOCK; block <= last / BLOCK; ++block) {
        const int end = bounded((block + 1) * BLOCK, 0, resolution);
        int mark = 0;
        for (int x = block * BLOCK; x < end; ++x)
            mark |= (short)(row[x] & 0xffff) < (int)near_surface;
        mark |= ((short)(row[block * BLOCK] & 0xffff) < (int)near_surface) << 1;
        mark |= y % BLOCK == 0 ? mark << 2 : 0;
        mark |= z % BLOCK == 0 ? mark << 4 : 0;
        marks[block] |= mark;
    }
}
#endif

// Fuses a depth image. Only voxels that the camera may see are visited, no deeper than the farthest depth plus mu. A
// block in which a voxel has come nearer to a surface than `near_surface` is marked for the raycast, for good.
// Rows: a work-item owns the 8x8 voxel rows along x of a row of blocks, and leaves out blocks hidden behind surfaces.
// Pixels: a work-item owns a column along z, so that neighbours in x read and write side by side.
kernel void integrate(global uint *restrict volume,
#ifndef PIXELS
                      global uchar *restrict weights, global const float *restrict tile_farthest,
#endif
                      int resolution, float voxel_size, global int *restrict surface, int blocks,
                      global const float *restrict depth, int width, int height, float4 camera, float mu,
                      float max_weight, float near_surface, int conditional, global const State *restrict state)
{
    if (conditional && !state->tracked)
        return;
    const float limit = state->farthest + mu;
    int first, last;
#ifdef PIXELS
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= resolution || y >= resolution)
        return;
    const float3 slope = voxel_size * (float3)(state->pose[8], state->pose[9], state->pose[10]);
    const float3 base = voxel_to_camera(state, x, y, 0, voxel_size);
    visible_range(base, slope, resolution, width, height, camera, limit, &first, &last);
    for (int z = first; z <= last; ++z) {
        const int i = (z * resolution + y) * resolution + x;
        const uint word = volume[i];
        int distance = (int)SCALE - (int)(word & 0xffff), weight = word >> 16;
        if (!fuse(&distance, &weight, base.x + z * slope.x, base.y + z * slope.y, base.z + z * slope.z, depth, width,
                  height, camera, mu, max_weight))
            continue;
        volume[i] = (uint)((int)SCALE - distance) | ((uint)weight << 16);
        // Several work-items may write here, and all of them the same.
        if (distance < (int)near_surface)
            surface[((z / BLOCK) * blocks + y / BLOCK) * blocks + x / BLOCK] = 1;
    }
#else
    const int block_y = get_global_id(0), block_z = get_global_id(1);
    global const float *pose = state->pose;
    const float3 slope = voxel_size * (float3)(pose[0], pose[1], pose[2]);
    const float3 along_y = voxel_size * (float3)(pose[4], pose[5], pose[6]);
    const float3 along_z = voxel_size * (float3)(pose[8], pose[9], pose[10]);
    const float3 half_size = 0.5f * (BLOCK - 1) * (fabs(slope) + fabs(along_y) + fabs(along_z));
    const float3 middle = voxel_to_camera(state, 0, block_y * BLOCK, block_z * BLOCK, voxel_size) +
                          0.5f * (BLOCK - 1) * (slope + along_y + along_z);
    int hidden[MOST_BLOCKS];
    for (int block = 0; block < bounded(blocks, 0, MOST_BLOCKS); ++block)
        hidden[block] = is_hidden(middle + block * BLOCK * slope, half_size, tile_farthest, width, height, camera, mu);
    const int end_z = bounded((block_z + 1) * BLOCK, 0, resolution);
    const int end_y = bounded((block_y + 1) * BLOCK, 0, resolution);
    for (int z = block_z * BLOCK; z < end_z; ++z)
        for (int y = block_y * BLOCK; y < end_y; ++y) {
            const float3 base = voxel_to_camera(state, 0, y, z, voxel_size);
            visible_range(base, slope, resolution, width, height, camera, limit, &first, &last);
            const int line = z * resolution + y;
            int start = first;
            while (start <= last) {
                // As far as blocks are hidden, or not.
                const int leave_out = start / BLOCK < MOST_BLOCKS && hidden[start / BLOCK];
                int next = (start / BLOCK + 1) * BLOCK;
                while (next <= last && leave_out == (next / BLOCK < MOST_BLOCKS && hidden[next / BLOCK]))
                    next += BLOCK;
                if (!leave_out)
                    fuse_stretch(volume + line * resolution, weights + line * resolution, resolution, y, z, start,
                                 bounded(next - 1, 0, last), base, slope,
                                 surface + (block_z * blocks + block_y) * blocks, depth, width, height, camera, mu,
                                 max_weight, near_surface);
                start = next;
            }
        }
#endif
}

// Whether interpolating in a block may read a marked voxel: one of its own, or of the first layer of a neighbour towards
// larger x, y or z, since interpolation reads one voxel further.
INLINE int is_searched(global const int *restrict surface, int blocks, int x, int y, int z)
{
    const int next = bounded(x + 1, 0, blocks - 1), above = bounded(y + 1, 0, blocks - 1);
    const int behind = bounded(z + 1, 0, blocks - 1);
    global const int *restrict here = surface + (z * blocks + y) * blocks;
    global const int *restrict up = surface + (z * blocks + above) * blocks;
    global const int *restrict back = surface + (behind * blocks + y) * blocks;
    global const int *restrict both = surface + (behind * blocks + above) * blocks;
    return ((here[x] & ANYWHERE) | (here[next] & FIRST(1)) | (up[x] & FIRST(2)) | (up[next] & FIRST(3)) |
            (back[x] & FIRST(4)) | (back[next] & FIRST(5)) | (both[x] & FIRST(6)) | (both[next] & FIRST(7))) != 0;
}

#ifndef PIXELS
// Lowers each block's distance to what the neighbours along `step` (1 forwards, -1 backwards) allow. `searched` holds
// distances; all rows before have been swept. Chessboard distances need one sweep forwards and one backwards.
INLINE void sweep_row(global int *restrict searched, int blocks, int y, int z, int step)
{
    global int *restrict row = searched + (z * blocks + y) * blocks;
    for (int neighbour = 0; neighbour < 4; ++neighbour) {
        const int line = y - step * (neighbour == 3 ? -1 : neighbour > 0), slice = z - step * (neighbour != 1);
        if (line < 0 || line >= blocks || slice < 0 || slice >= blocks)
            continue;
        global const int *restrict other = searched + (slice * blocks + line) * blocks;
        for (int x = 0; x < blocks; ++x) {
            const int before = other[bounded(x - 1, 0, blocks - 1)], after = other[bounded(x + 1, 0, blocks - 1)];
            const int least = before < after ? before : after, nearest = other[x] < least ? other[x] : least;
            row[x] = nearest + 1 < row[x] ? nearest + 1 : row[x];
        }
    }
    int last = blocks;
    for (int k = 0; k < blocks; ++k) {
        const int x = step > 0 ? k : blocks - 1 - k;
        last = row[x] < last + 1 ? row[x] : last + 1;
        row[x] = last;
    }
}
#endif

// A block that must be searched holds 1. Pixels: others hold 0. Rows: they hold 0 or less: so many blocks more on each
// side need no search either. Pixels: a work-item per block. Rows: one work-item.
kernel void dilate_blocks(global const int *restrict surface, global int *restrict searched, int blocks,
                          int conditional, global const State *restrict state)
{
    if (conditional && !state->tracked)
        return;
#ifdef PIXELS
    const int x = get_global_id(0), line = get_global_id(1);
    if (x < blocks && line < blocks * blocks)
        searched[line * blocks + x] = is_searched(surface, blocks, x, line % blocks, line / blocks);
#else
    for (int line = 0; line < blocks * blocks; ++line) {
        const int y = line % blocks, z = line / blocks;
        for (int x = 0; x < blocks; ++x)
            searched[line * blocks + x] = is_searched(surface, blocks, x, y, z) ? 0 : blocks;
        sweep_row(searched, blocks, y, z, 1);
    }
    for (int line = blocks * blocks - 1; line >= 0; --line)
        sweep_row(searched, blocks, line % blocks, line / blocks, -1);
    for (int block = 0; block < blocks * blocks * blocks; ++block)
        searched[block] = 1 - searched[block];
#endif
}
