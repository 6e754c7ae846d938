// The truncated signed distance function (Newcombe et al. 2011, section 3.3; Curless and Levoy 1996).
// A distance is a signed 16-bit number, SCALE for one truncation distance. Voxel (x, y, z) is centred at (x+.5, y+.5, z+.5).
// Rows: a voxel's word holds its distance in the low half and, for the raycast, that of its neighbour at x + 1 in the high
// half: interpolating along x then takes one load. Weights lie in a plane of their own.
// Pixels: the low half holds SCALE minus the distance, the high half the weight: a word of 0 is empty space, never observed.
#include "arithmetic.h"

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

// Fuses a depth image. Only voxels that the camera may see are visited, no deeper than the farthest depth plus mu. A
// block in which a voxel has come nearer to a surface than `near_surface` is marked for the raycast, for good.
// Rows: a work-item owns the 8x8 voxel rows along x of a row of blocks.
// Pixels: a work-item owns a column along z, so that neighbours in x read and write side by side.
kernel void integrate(global uint *restrict volume,
#ifndef PIXELS
                      global uchar *restrict weights,
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
    const float3 slope = voxel_size * (float3)(state->pose[0], state->pose[1], state->pose[2]);
    const int end_z = bounded((block_z + 1) * BLOCK, 0, resolution);
    const int end_y = bounded((block_y + 1) * BLOCK, 0, resolution);
    for (int z = block_z * BLOCK; z < end_z; ++z)
        for (int y = block_y * BLOCK; y < end_y; ++y) {
            const float3 base = voxel_to_camera(state, 0, y, z, voxel_size);
            visible_range(base, slope, resolution, width, height, camera, limit, &first, &last);
            global uint *restrict row = volume + (z * resolution + y) * resolution;
            global uchar *restrict row_weights = weights + (z * resolution + y) * resolution;
            const float base_x = base.x, base_y = base.y, base_z = base.z;
            const float slope_x = slope.x, slope_y = slope.y, slope_z = slope.z;
            int changed = 0, near = 0;
            for (int x = first; x <= last; ++x) {
                const uint word = row[x];
                int distance = (short)(word & 0xffff), weight = row_weights[x];
                const int update = fuse(&distance, &weight, base_x + x * slope_x, base_y + x * slope_y,
                                        base_z + x * slope_z, depth, width, height, camera, mu, max_weight);
                row[x] = (word & 0xffff0000) | ((uint)distance & 0xffff);
                row_weights[x] = weight;
                changed |= update;
                near |= update & (distance < (int)near_surface);
            }
            if (!changed)
                continue;
            for (int x = bounded(first - 1, 0, last); x <= bounded(last, 0, resolution - 2); ++x)
                row[x] = (row[x] & 0xffff) | (row[x + 1] << 16);
            if (!near)
                continue;
            global int *restrict marks = surface + (block_z * blocks + block_y) * blocks;
            for (int block = first / BLOCK; block <= last / BLOCK; ++block) {
                const int end = bounded((block + 1) * BLOCK, 0, resolution);
                int mark = 0;
                for (int x = block * BLOCK; x < end; ++x)
                    mark |= (short)(row[x] & 0xffff) < (int)near_surface;
                marks[block] |= mark;
            }
        }
#endif
}

INLINE int near_surface_at(global const int *restrict surface, int blocks, int x, int y, int z)
{
    const int next = bounded(x + 1, 0, blocks - 1), above = bounded(y + 1, 0, blocks - 1);
    const int behind = bounded(z + 1, 0, blocks - 1);
    return surface[(z * blocks + y) * blocks + x] | surface[(z * blocks + y) * blocks + next] |
           surface[(z * blocks + above) * blocks + x] | surface[(z * blocks + above) * blocks + next] |
           surface[(behind * blocks + y) * blocks + x] | surface[(behind * blocks + y) * blocks + next] |
           surface[(behind * blocks + above) * blocks + x] | surface[(behind * blocks + above) * blocks + next];
}

// A block must be searched when it or a neighbour towards larger x, y or z is marked: trilinear
// interpolation reads one voxel further.
kernel void dilate_blocks(global const int *restrict surface, global int *restrict searched, int blocks,
                          int conditional, global const State *restrict state)
{
    if (conditional && !state->tracked)
        return;
#ifdef PIXELS
    const int x = get_global_id(0), line = get_global_id(1);
    if (x < blocks && line < blocks * blocks)
        searched[line * blocks + x] = near_surface_at(surface, blocks, x, line % blocks, line / blocks);
#else
    const int y = get_global_id(0), z = get_global_id(1);
    for (int x = 0; x < blocks; ++x)
        searched[(z * blocks + y) * blocks + x] = near_surface_at(surface, blocks, x, y, z);
#endif
}
