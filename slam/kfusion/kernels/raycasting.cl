// The model that tracking sees: surface points and normals along the rays of a camera
// (Newcombe et al. 2011, section 3.4). One work-item per image row.
#include "arithmetic.h"
#include "state.h"

#define SCALE 32766.0f
#define BLOCK 8
#define LANES 16

INLINE float distance_at(global const uint *restrict volume, int index)
{
    return (short)(volume[index] & 0xffff);
}

// Trilinear interpolation at (x, y, z) in voxels, 0 at the centre of the first; clamped at the sides.
INLINE float interpolate(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    // Rays stay above -1, where truncation after adding 1 rounds down.
    const int base_x = (int)(x + 1.0f) - 1, base_y = (int)(y + 1.0f) - 1, base_z = (int)(z + 1.0f) - 1;
    const float fx = x - base_x, fy = y - base_y, fz = z - base_z;
    const int top = resolution - 1;
    const int x0 = bounded(base_x, 0, top), x1 = bounded(base_x + 1, 0, top);
    const int y0 = bounded(base_y, 0, top) * resolution, y1 = bounded(base_y + 1, 0, top) * resolution;
    const int z0 = bounded(base_z, 0, top) * resolution * resolution;
    const int z1 = bounded(base_z + 1, 0, top) * resolution * resolution;
    const float near_upper = distance_at(volume, z0 + y0 + x0) * (1.0f - fx) + distance_at(volume, z0 + y0 + x1) * fx;
    const float near_lower = distance_at(volume, z0 + y1 + x0) * (1.0f - fx) + distance_at(volume, z0 + y1 + x1) * fx;
    const float far_upper = distance_at(volume, z1 + y0 + x0) * (1.0f - fx) + distance_at(volume, z1 + y0 + x1) * fx;
    const float far_lower = distance_at(volume, z1 + y1 + x0) * (1.0f - fx) + distance_at(volume, z1 + y1 + x1) * fx;
    return (near_upper * (1.0f - fy) + near_lower * fy) * (1.0f - fz) +
           (far_upper * (1.0f - fy) + far_lower * fy) * fz;
}

// The ray parameter at which one axis leaves the box [0, size].
INLINE float entry(float origin, float direction, float size)
{
    const float a = -origin / direction, b = (size - origin) / direction;
    return smaller(a, b);
}

INLINE float leaving(float origin, float direction, float size)
{
    const float a = -origin / direction, b = (size - origin) / direction;
    return larger(a, b);
}

// Remembers which pixels the model belongs to: intrinsics times the inverse of the pose.
kernel void view_from(float4 camera, global State *state)
{
    for (int column = 0; column < 4; ++column) {
        float inverse[3];
        for (int row = 0; row < 3; ++row)
            inverse[row] = column < 3 ? state->pose[4 * column + row]
                                      : -(state->pose[row] * state->pose[3] + state->pose[4 + row] * state->pose[7] +
                                          state->pose[8 + row] * state->pose[11]);
        state->view[column] = camera.x * inverse[0] + camera.z * inverse[2];
        state->view[4 + column] = camera.y * inverse[1] + camera.w * inverse[2];
        state->view[8 + column] = inverse[2];
    }
}

// Marches sixteen rays side by side. A ray's parameter is its depth along the optical axis. It advances by
// `large_step` until the distance falls below `near_surface`, from then on by `small_step`, to the first
// negative value; the crossing is interpolated. Blocks far from every surface are jumped by whole
// steps, so that the points that matter are the same as without jumping. A ray that starts inside or
// behind a surface, or finds none, yields a zero vertex and a zero normal.
kernel void raycast(global const uint *restrict volume, int resolution, float voxel_size,
                    global const int *restrict searched, int blocks, int width, float4 camera, float near_plane,
                    float far_plane, float small_step, float large_step, float near_surface,
                    global const State *restrict state, global float *restrict vertex_x,
                    global float *restrict vertex_y, global float *restrict vertex_z, global float *restrict normal_x,
                    global float *restrict normal_y, global float *restrict normal_z)
{
    const int row = get_global_id(0);
    global const float *pose = state->pose;
    const float size = resolution * voxel_size, per_voxel = 1.0f / voxel_size;
    const float tiny = 1e-9f;
    // From here on lengths are voxels, with 0 at the centre of the first.
    const float origin_x = pose[3] * per_voxel - 0.5f;
    const float origin_y = pose[7] * per_voxel - 0.5f;
    const float origin_z = pose[11] * per_voxel - 0.5f;
    const float ray_y = (row - camera.w) / camera.y;

    for (int start = 0; start < width; start += LANES) {
        float dx[LANES], dy[LANES], dz[LANES], t[LANES], end[LANES], step[LANES];
        int active[LANES], hit[LANES], first[LANES];

        for (int l = 0; l < LANES; ++l) {
            const float ray_x = (start + l - camera.z) / camera.x;
            float x = pose[0] * ray_x + pose[1] * ray_y + pose[2];
            float y = pose[4] * ray_x + pose[5] * ray_y + pose[6];
            float z = pose[8] * ray_x + pose[9] * ray_y + pose[10];
            x = magnitude(x) > tiny ? x : tiny;
            y = magnitude(y) > tiny ? y : tiny;
            z = magnitude(z) > tiny ? z : tiny;
            float from = near_plane, to = far_plane;
            const float in_x = entry(pose[3], x, size), in_y = entry(pose[7], y, size), in_z = entry(pose[11], z, size);
            const float out_x = leaving(pose[3], x, size), out_y = leaving(pose[7], y, size),
                        out_z = leaving(pose[11], z, size);
            from = larger(from, in_x);
            from = larger(from, in_y);
            from = larger(from, in_z);
            to = smaller(to, out_x);
            to = smaller(to, out_y);
            to = smaller(to, out_z);
            dx[l] = x * per_voxel;
            dy[l] = y * per_voxel;
            dz[l] = z * per_voxel;
            t[l] = from;
            end[l] = to;
            step[l] = large_step;
            active[l] = (from < to) & (start + l < width);
            hit[l] = 0;
            first[l] = 1;
        }

        int searching = 1;
        while (searching) {
            int jumping = 1;
            while (jumping) {
                jumping = 0;
                for (int l = 0; l < LANES; ++l) {
                    const float place = active[l] ? t[l] : near_plane;
                    const float x = origin_x + place * dx[l], y = origin_y + place * dy[l],
                                z = origin_z + place * dz[l];
                    const float bx = (int)(x * 0.125f + 1.0f) - 1, by = (int)(y * 0.125f + 1.0f) - 1,
                                bz = (int)(z * 0.125f + 1.0f) - 1;
                    const int ix = bounded((int)bx, 0, blocks - 1), iy = bounded((int)by, 0, blocks - 1),
                              iz = bounded((int)bz, 0, blocks - 1);
                    const int empty = active[l] & (searched[(iz * blocks + iy) * blocks + ix] == 0);
                    const float out_x = ((dx[l] > 0.0f ? bx + 1.0f : bx) * BLOCK - x) / dx[l];
                    const float out_y = ((dy[l] > 0.0f ? by + 1.0f : by) * BLOCK - y) / dy[l];
                    const float out_z = ((dz[l] > 0.0f ? bz + 1.0f : bz) * BLOCK - z) / dz[l];
                    const float out = smaller(larger(smaller(smaller(out_x, out_y), out_z), 0.0f), far_plane);
                    const int steps = (int)(out / step[l]) + 1;
                    t[l] += empty ? steps * step[l] : 0.0f;
                    first[l] &= !empty;
                    active[l] &= t[l] < end[l];
                    jumping |= empty & active[l];
                }
            }
            searching = 0;
            for (int l = 0; l < LANES; ++l) {
                const float place = active[l] ? t[l] : near_plane;
                const float value = interpolate(volume, resolution, origin_x + place * dx[l],
                                                origin_y + place * dy[l], origin_z + place * dz[l]);
                const int inside = active[l] & first[l] & (value <= 0.0f);
                const int crossed = active[l] & (value < 0.0f);
                hit[l] |= crossed & !inside;
                active[l] &= !(crossed | inside);
                step[l] = (active[l] & (value < near_surface)) ? small_step : step[l];
                t[l] += active[l] ? step[l] : 0.0f;
                active[l] &= t[l] < end[l];
                first[l] = 0;
                searching |= active[l];
            }
        }

        float vx[LANES], vy[LANES], vz[LANES], nx[LANES], ny[LANES], nz[LANES];
        for (int l = 0; l < LANES; ++l) {
            const float at = hit[l] ? t[l] : near_plane, before = hit[l] ? t[l] - step[l] : near_plane;
            const float value = interpolate(volume, resolution, origin_x + at * dx[l], origin_y + at * dy[l],
                                            origin_z + at * dz[l]);
            const float earlier = interpolate(volume, resolution, origin_x + before * dx[l],
                                              origin_y + before * dy[l], origin_z + before * dz[l]);
            const float difference = earlier - value;
            const int crossing = hit[l] & (difference > 0.0f);
            const float place = at + (crossing ? step[l] * value / difference : 0.0f);
            vx[l] = origin_x + place * dx[l];
            vy[l] = origin_y + place * dy[l];
            vz[l] = origin_z + place * dz[l];
            hit[l] = crossing;
        }
        // Away from the volume's sides this equals interpolating the central differences of the voxels.
        for (int l = 0; l < LANES; ++l) {
            const float x = hit[l] ? vx[l] : 1.0f, y = hit[l] ? vy[l] : 1.0f, z = hit[l] ? vz[l] : 1.0f;
            const float gx = interpolate(volume, resolution, x + 1.0f, y, z) -
                             interpolate(volume, resolution, x - 1.0f, y, z);
            const float gy = interpolate(volume, resolution, x, y + 1.0f, z) -
                             interpolate(volume, resolution, x, y - 1.0f, z);
            const float gz = interpolate(volume, resolution, x, y, z + 1.0f) -
                             interpolate(volume, resolution, x, y, z - 1.0f);
            const float square = gx * gx + gy * gy + gz * gz;
            hit[l] &= square > 0.0f;
            const float scale = inverse_root(square > 0.0f ? square : 1.0f);
            nx[l] = gx * scale;
            ny[l] = gy * scale;
            nz[l] = gz * scale;
        }
        const int count = bounded(width - start, 0, LANES);
        for (int l = 0; l < count; ++l) {
            const int i = row * width + start + l;
            vertex_x[i] = hit[l] ? (vx[l] + 0.5f) * voxel_size : 0.0f;
            vertex_y[i] = hit[l] ? (vy[l] + 0.5f) * voxel_size : 0.0f;
            vertex_z[i] = hit[l] ? (vz[l] + 0.5f) * voxel_size : 0.0f;
            normal_x[i] = hit[l] ? nx[l] : 0.0f;
            normal_y[i] = hit[l] ? ny[l] : 0.0f;
            normal_z[i] = hit[l] ? nz[l] : 0.0f;
        }
    }
}
