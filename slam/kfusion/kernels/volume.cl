// The truncated signed distance function (Newcombe et al. 2011, section 3.3; Curless and Levoy 1996).
// A voxel is one 32-bit word: the distance as a signed 16-bit number in the low half, 32766 for one
// truncation distance, and the weight in the high half. Voxel (x, y, z) is centred at (x+.5, y+.5, z+.5).
#include "arithmetic.h"
#include "state.h"

#define SCALE 32766.0f
#define BLOCK 8

// Empty space everywhere, nothing observed.
kernel void clear_volume(global uint *restrict volume, int resolution, global int *restrict surface, int blocks)
{
    const int z = get_global_id(0);
    const int plane = resolution * resolution;
    for (int i = 0; i < plane; ++i)
        volume[z * plane + i] = 32766;
    if (z < blocks)
        for (int i = 0; i < blocks * blocks; ++i)
            surface[z * blocks * blocks + i] = 0;
}

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

// Fuses a depth image. A work-item owns the 8x8 voxel rows along x of a row of blocks. Each row is cut
// to the part that the camera can see, no deeper than the farthest depth plus mu. A block in which a
// voxel has come nearer to a surface than `near_surface` is marked for the raycast, for good.
kernel void integrate(global uint *restrict volume, int resolution, float voxel_size, global int *restrict surface,
                      int blocks, global const float *restrict depth, int width, int height, float4 camera, float mu,
                      float max_weight, float near_surface, global const State *restrict state)
{
    const int block_y = get_global_id(0), block_z = get_global_id(1);
    global const float *pose = state->pose;
    const float right = width - 1, bottom = height - 1;
    const float limit = state->farthest + mu;
    const float per_mu = SCALE / mu;
    // Along x, a voxel's place in the camera's frame moves by the first row of the rotation.
    const float slope_x = voxel_size * pose[0], slope_y = voxel_size * pose[1], slope_z = voxel_size * pose[2];

    const int last_z = bounded((block_z + 1) * BLOCK, 0, resolution);
    const int last_y = bounded((block_y + 1) * BLOCK, 0, resolution);
    for (int z = block_z * BLOCK; z < last_z; ++z)
        for (int y = block_y * BLOCK; y < last_y; ++y) {
            const float px = 0.5f * voxel_size - pose[3];
            const float py = (y + 0.5f) * voxel_size - pose[7];
            const float pz = (z + 0.5f) * voxel_size - pose[11];
            const float base_x = pose[0] * px + pose[4] * py + pose[8] * pz;
            const float base_y = pose[1] * px + pose[5] * py + pose[9] * pz;
            const float base_z = pose[2] * px + pose[6] * py + pose[10] * pz;

            float from = 0.0f, to = resolution - 1;
            clip(base_z, slope_z, &from, &to);
            clip(limit - base_z, -slope_z, &from, &to);
            const float left_u = camera.z + 0.5f, right_u = camera.z + 0.5f - right;
            clip(camera.x * base_x + left_u * base_z, camera.x * slope_x + left_u * slope_z, &from, &to);
            clip(-camera.x * base_x - right_u * base_z, -camera.x * slope_x - right_u * slope_z, &from, &to);
            const float top_v = camera.w + 0.5f, bottom_v = camera.w + 0.5f - bottom;
            clip(camera.y * base_y + top_v * base_z, camera.y * slope_y + top_v * slope_z, &from, &to);
            clip(-camera.y * base_y - bottom_v * base_z, -camera.y * slope_y - bottom_v * slope_z, &from, &to);
            if (!(from <= to))
                continue;

            const int first = (int)from, last = bounded((int)to, 0, resolution - 1);
            global uint *restrict row = volume + (z * resolution + y) * resolution;
            int touched = 0;
            for (int x = first; x <= last; ++x) {
                const float cx = base_x + x * slope_x, cy = base_y + x * slope_y, cz = base_z + x * slope_z;
                const float inverse_z = 1.0f / cz;
                const float ray_x = cx * inverse_z, ray_y = cy * inverse_z;
                const float u = camera.x * ray_x + left_u, v = camera.y * ray_y + top_v;
                const int visible =
                    (cz > 0.0001f) & (u >= 0.0f) & (u <= right) & (v >= 0.0f) & (v <= bottom);
                const float measured = depth[(int)(visible ? v : 0.0f) * width + (int)(visible ? u : 0.0f)];
                const float square = 1.0f + ray_x * ray_x + ray_y * ray_y;
                const float difference = (measured - cz) * square * inverse_root(square);
                const int update = visible & (measured > 0.0f) & (difference > -mu);

                const uint voxel = row[x];
                const float distance = (short)(voxel & 0xffff), weight = voxel >> 16;
                const float observed = difference * per_mu;
                const float mean = (distance * weight + smaller(observed, SCALE)) / (weight + 1.0f);
                // Adding 32768.5 makes truncation round to the nearest, also below zero.
                const int rounded = (int)(larger(mean, -SCALE) + 32768.5f) - 32768;
                const float heavier = smaller(weight + 1.0f, max_weight);
                row[x] = update ? (((uint)(int)heavier) << 16) | ((uint)rounded & 0xffff) : voxel;
                touched |= update & (rounded < (int)near_surface);
            }
            if (!touched)
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
}

// A block must be searched when it or a neighbour towards larger x, y or z is marked: trilinear
// interpolation reads one voxel further.
kernel void dilate_blocks(global const int *restrict surface, global int *restrict searched, int blocks)
{
    const int y = get_global_id(0), z = get_global_id(1);
    const int above = bounded(y + 1, 0, blocks - 1), behind = bounded(z + 1, 0, blocks - 1);
    for (int x = 0; x < blocks; ++x) {
        const int next = bounded(x + 1, 0, blocks - 1);
        searched[(z * blocks + y) * blocks + x] =
            surface[(z * blocks + y) * blocks + x] | surface[(z * blocks + y) * blocks + next] |
            surface[(z * blocks + above) * blocks + x] | surface[(z * blocks + above) * blocks + next] |
            surface[(behind * blocks + y) * blocks + x] | surface[(behind * blocks + y) * blocks + next] |
            surface[(behind * blocks + above) * blocks + x] | surface[(behind * blocks + above) * blocks + next];
    }
}
