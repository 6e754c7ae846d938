// The model that tracking sees: surface points and normals along the rays of a camera
// (Newcombe et al. 2011, section 3.4).
#include "arithmetic.h"

#define LANES 16
#define JUMPS 12  // at most, over empty blocks
#define SAMPLES 6 // at most, near surfaces, between two moments at which lanes may take their next ray

#ifdef PIXELS
// The distance in the low half of a word is stored as SCALE minus itself; here it stays so.
INLINE float stored(uint word)
{
    return word & 0xffff;
}

INLINE float along_line(global const uint *restrict volume, int i, float fraction)
{
    const float here = stored(volume[i]), next = stored(volume[i + 1]);
    return here + (next - here) * fraction;
}
#define UNSTORED(mean) (SCALE - (mean))
#else
// Between the distances in a word, those of two neighbours in x.
INLINE float along_line(global const uint *restrict volume, int i, float fraction)
{
    const uint word = volume[i];
    const float here = (short)(word & 0xffff), next = (short)(word >> 16);
    return here + (next - here) * fraction;
}
#define UNSTORED(mean) (mean)
#endif

// Trilinear interpolation at (x, y, z) in voxels, 0 at the centre of the first and resolution - 1 at that of
// the last; slightly beyond them the outermost cell is extrapolated.
INLINE float interpolate(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    const int column = bounded((int)x, 0, resolution - 2);
    const int line = bounded((int)y, 0, resolution - 2);
    const int slice = bounded((int)z, 0, resolution - 2);
    const float fx = x - column, fy = y - line, fz = z - slice;
    const int corner = (slice * resolution + line) * resolution + column;
    const int far_corner = corner + resolution * resolution;
    const float a = along_line(volume, corner, fx), b = along_line(volume, corner + resolution, fx);
    const float c = along_line(volume, far_corner, fx), d = along_line(volume, far_corner + resolution, fx);
    const float near_side = a + (b - a) * fy, far_side = c + (d - c) * fy;
    return UNSTORED(near_side + (far_side - near_side) * fz);
}

// Where a ray enters and leaves the slab [0, last] of one axis; `inverse` is 1 / direction.
INLINE float entry(float origin, float inverse, float last)
{
    return smaller(-origin * inverse, (last - origin) * inverse);
}

INLINE float leaving(float origin, float inverse, float last)
{
    return larger(-origin * inverse, (last - origin) * inverse);
}

// A direction that can be divided by.
INLINE float nonzero(float direction)
{
    return magnitude(direction) > 1e-9f ? direction : 1e-9f;
}

// The block of 8x8x8 voxels that a coordinate lies in.
INLINE int block_of(float voxel, int blocks)
{
    return bounded((int)(voxel * (1.0f / BLOCK)), 0, blocks - 1);
}

// How far along a ray one axis leaves the block that x lies in, and `around` blocks on each side of it.
INLINE float out_of(int block, int around, float x, float direction, float inverse)
{
    return ((direction > 0.0f ? block + 1 + around : block - around) * BLOCK - x) * inverse;
}

#ifdef PIXELS
// The gradient of the distance at (x, y, z). Away from the volume's sides this equals interpolating the central
// differences of the voxels.
INLINE float along_x(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    return interpolate(volume, resolution, x + 1.0f, y, z) - interpolate(volume, resolution, x - 1.0f, y, z);
}

INLINE float along_y(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    return interpolate(volume, resolution, x, y + 1.0f, z) - interpolate(volume, resolution, x, y - 1.0f, z);
}

INLINE float along_z(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    return interpolate(volume, resolution, x, y, z + 1.0f) - interpolate(volume, resolution, x, y, z - 1.0f);
}
#else
// Between two rows of voxels and between two slices.
INLINE float between(float a, float b, float c, float d, float fy, float fz)
{
    const float near_side = a + (b - a) * fy, far_side = c + (d - c) * fy;
    return near_side + (far_side - near_side) * fz;
}

typedef struct {
    float before, here, after; // along the line, a voxel before the place, there and a voxel after it
} Line;

// The low and the high half of a word.
INLINE float lower(uint word)
{
    return (short)(word & 0xffff);
}

INLINE float upper(uint word)
{
    return (short)(word >> 16);
}

INLINE Line line_around(global const uint *restrict volume, int i, float fraction)
{
    const uint left = volume[i - 1], right = volume[i + 1];
    const float a = lower(left), b = upper(left), c = lower(right), d = upper(right);
    Line line;
    line.before = a + (b - a) * fraction;
    line.here = b + (c - b) * fraction;
    line.after = c + (d - c) * fraction;
    return line;
}

typedef struct {
    float x, y, z;
} Gradient;

// The gradient of the distance: away from the volume's sides, interpolation a voxel farther less that a voxel before. The
// six interpolations share what they read.
INLINE Gradient gradient(global const uint *restrict volume, int resolution, float x, float y, float z)
{
    const int column = bounded((int)x, 1, resolution - 3);
    const int line = bounded((int)y, 1, resolution - 3);
    const int slice = bounded((int)z, 1, resolution - 3);
    const float fx = x - column, fy = y - line, fz = z - slice;
    const int row = resolution, plane = resolution * resolution;
    const int a = slice * plane + line * row + column, b = a + row, c = a + plane, d = c + row;
    const Line la = line_around(volume, a, fx), lb = line_around(volume, b, fx);
    const Line lc = line_around(volume, c, fx), ld = line_around(volume, d, fx);
    const float over_a = along_line(volume, a - row, fx), under_b = along_line(volume, b + row, fx);
    const float over_c = along_line(volume, c - row, fx), under_d = along_line(volume, d + row, fx);
    const float front_a = along_line(volume, a - plane, fx), front_b = along_line(volume, b - plane, fx);
    const float back_c = along_line(volume, c + plane, fx), back_d = along_line(volume, d + plane, fx);
    Gradient g;
    g.x = between(la.after - la.before, lb.after - lb.before, lc.after - lc.before, ld.after - ld.before, fy, fz);
    g.y = between(lb.here - over_a, under_b - la.here, ld.here - over_c, under_d - lc.here, fy, fz);
    g.z = between(lc.here - front_a, ld.here - front_b, back_c - la.here, back_d - lb.here, fy, fz);
    return g;
}
#endif

// Finds the surface along the ray of each pixel. A ray's parameter is its depth along the optical axis. It advances by
// `large_step` until the distance falls below `near_surface`, from then on by `small_step`, to the first negative value;
// the crossing is interpolated. Blocks far from every surface are jumped by whole steps, so that the points that matter
// are the same as without jumping. A ray that starts inside or behind a surface, or finds none, yields a zero vertex
// and a zero normal. Lengths are voxels, with 0 at the centre of the first; rays keep between the outermost centres.
kernel void raycast(global const uint *restrict volume, int resolution, float voxel_size,
                    global const int *restrict searched, int blocks, int width, int height, float4 camera,
                    float near_plane, float far_plane, float small_step, float large_step, float near_surface,
                    global const State *restrict state, global float *restrict vertex_x,
                    global float *restrict vertex_y, global float *restrict vertex_z, global float *restrict normal_x,
                    global float *restrict normal_y, global float *restrict normal_z)
{
    float pose[12];
    for (int k = 0; k < 12; ++k)
        pose[k] = state->pose[k];
    const float per_voxel = 1.0f / voxel_size, last = resolution - 1;
    const float origin_x = pose[3] * per_voxel - 0.5f;
    const float origin_y = pose[7] * per_voxel - 0.5f;
    const float origin_z = pose[11] * per_voxel - 0.5f;

#ifdef PIXELS
    const int column = get_global_id(0), row = get_global_id(1);
    if (column >= width || row >= height)
        return;
    const float ray_x = (column - camera.z) / camera.x, ray_y = (row - camera.w) / camera.y;
    const float dx = nonzero((pose[0] * ray_x + pose[1] * ray_y + pose[2]) * per_voxel);
    const float dy = nonzero((pose[4] * ray_x + pose[5] * ray_y + pose[6]) * per_voxel);
    const float dz = nonzero((pose[8] * ray_x + pose[9] * ray_y + pose[10]) * per_voxel);
    const float ix = 1.0f / dx, iy = 1.0f / dy, iz = 1.0f / dz;
    float t = larger(larger(larger(near_plane, entry(origin_x, ix, last)), entry(origin_y, iy, last)),
                     entry(origin_z, iz, last));
    const float end = smaller(smaller(smaller(far_plane, leaving(origin_x, ix, last)), leaving(origin_y, iy, last)),
                              leaving(origin_z, iz, last));
    float step = large_step, value = 0.0f;
    int first = 1;
    while (t < end) {
        const float x = origin_x + t * dx, y = origin_y + t * dy, z = origin_z + t * dz;
        const int bx = block_of(x, blocks), by = block_of(y, blocks), bz = block_of(z, blocks);
        if (searched[(bz * blocks + by) * blocks + bx] == 0) {
            const float out_x = out_of(bx, 0, x, dx, ix), out_y = out_of(by, 0, y, dy, iy);
            const float out_z = out_of(bz, 0, z, dz, iz);
            const float out = smaller(larger(smaller(smaller(out_x, out_y), out_z), 0.0f), far_plane);
            const int steps = (int)(out / step) + 1;
            t += steps * step;
        } else {
            value = interpolate(volume, resolution, x, y, z);
            if (value < 0.0f || (first && value == 0.0f))
                break;
            step = value < near_surface ? small_step : step;
            t += step;
        }
        first = 0;
    }
    float x = 0.0f, y = 0.0f, z = 0.0f, gx = 0.0f, gy = 0.0f, gz = 0.0f;
    if (t < end && !first) {
        const float before = t - step;
        const float earlier = interpolate(volume, resolution, origin_x + before * dx, origin_y + before * dy,
                                          origin_z + before * dz);
        if (earlier > value) {
            t += step * value / (earlier - value);
            x = origin_x + t * dx;
            y = origin_y + t * dy;
            z = origin_z + t * dz;
            gx = along_x(volume, resolution, x, y, z);
            gy = along_y(volume, resolution, x, y, z);
            gz = along_z(volume, resolution, x, y, z);
        }
    }
    const float square = gx * gx + gy * gy + gz * gz;
    const int found = square > 0.0f;
    const float scale = found ? inverse_root(square) : 0.0f;
    const int i = row * width + column;
    vertex_x[i] = found ? (x + 0.5f) * voxel_size : 0.0f;
    vertex_y[i] = found ? (y + 0.5f) * voxel_size : 0.0f;
    vertex_z[i] = found ? (z + 0.5f) * voxel_size : 0.0f;
    normal_x[i] = gx * scale;
    normal_y[i] = gy * scale;
    normal_z[i] = gz * scale;
#else
    // A work-item finds the rays of a row in three loops over it. The output planes hold what passes between them.
    const int row = get_global_id(0);
    const float ray_y = (row - camera.w) / camera.y;
    const float base_x = pose[1] * ray_y + pose[2], base_y = pose[5] * ray_y + pose[6], base_z = pose[9] * ray_y + pose[10];
    global float *restrict starts = normal_x + row * width, *restrict ends = normal_y + row * width;
    global float *restrict places = vertex_x + row * width, *restrict steps_taken = vertex_y + row * width;
    global float *restrict values = vertex_z + row * width;

    // Where each ray enters and leaves the volume. A step of 0 says that nothing was found.
    for (int column = 0; column < width; ++column) {
        const float ray_x = (column - camera.z) / camera.x;
        const float ix = 1.0f / nonzero((pose[0] * ray_x + base_x) * per_voxel);
        const float iy = 1.0f / nonzero((pose[4] * ray_x + base_y) * per_voxel);
        const float iz = 1.0f / nonzero((pose[8] * ray_x + base_z) * per_voxel);
        starts[column] = larger(larger(larger(near_plane, entry(origin_x, ix, last)), entry(origin_y, iy, last)),
                                entry(origin_z, iz, last));
        ends[column] = smaller(smaller(smaller(far_plane, leaving(origin_x, ix, last)), leaving(origin_y, iy, last)),
                               leaving(origin_z, iz, last));
        steps_taken[column] = 0.0f;
    }

    // LANES rays march side by side; a lane whose ray has ended takes the next one of the row.
    float dx[LANES], dy[LANES], dz[LANES], ix[LANES], iy[LANES], iz[LANES];
    float t[LANES], end[LANES], step[LANES], value[LANES];
    int active[LANES], hit[LANES], first[LANES], pixel[LANES];
    for (int l = 0; l < LANES; ++l) {
        dx[l] = dy[l] = dz[l] = ix[l] = iy[l] = iz[l] = step[l] = 1.0f;
        t[l] = end[l] = value[l] = 0.0f;
        active[l] = hit[l] = first[l] = pixel[l] = 0;
    }
    int next = 0, marching = 1;
    while (marching) {
        marching = 0;
        for (int l = 0; l < LANES; ++l) {
            if (!active[l]) {
                if (hit[l]) {
                    places[pixel[l]] = t[l];
                    steps_taken[pixel[l]] = step[l];
                    values[pixel[l]] = value[l];
                    hit[l] = 0;
                }
                while (next < width && !(starts[next] < ends[next]))
                    ++next;
                if (next < width) {
                    const float ray_x = (next - camera.z) / camera.x;
                    dx[l] = nonzero((pose[0] * ray_x + base_x) * per_voxel);
                    dy[l] = nonzero((pose[4] * ray_x + base_y) * per_voxel);
                    dz[l] = nonzero((pose[8] * ray_x + base_z) * per_voxel);
                    ix[l] = 1.0f / dx[l];
                    iy[l] = 1.0f / dy[l];
                    iz[l] = 1.0f / dz[l];
                    t[l] = starts[next];
                    end[l] = ends[next];
                    step[l] = large_step;
                    first[l] = active[l] = 1;
                    pixel[l] = next++;
                }
            }
            marching |= active[l];
        }
        for (int jump = 0, jumping = 1; jump < JUMPS && jumping; ++jump) {
            jumping = 0;
            for (int l = 0; l < LANES; ++l) {
                const float place = active[l] ? t[l] : near_plane;
                const float x = origin_x + place * dx[l];
                const float y = origin_y + place * dy[l];
                const float z = origin_z + place * dz[l];
                const int bx = block_of(x, blocks), by = block_of(y, blocks), bz = block_of(z, blocks);
                const int around = -searched[(bz * blocks + by) * blocks + bx];
                const int empty = active[l] & (around >= 0);
                const float out_x = out_of(bx, around, x, dx[l], ix[l]);
                const float out_y = out_of(by, around, y, dy[l], iy[l]);
                const float out_z = out_of(bz, around, z, dz[l], iz[l]);
                const float out = smaller(larger(smaller(smaller(out_x, out_y), out_z), 0.0f), far_plane);
                const int steps = (int)(out / step[l]) + 1;
                t[l] += empty ? steps * step[l] : 0.0f;
                first[l] &= !empty;
                active[l] &= t[l] < end[l];
                jumping |= empty;
            }
        }
        for (int sample = 0, sampling = 1; sample < SAMPLES && sampling; ++sample) {
            sampling = 0;
            for (int l = 0; l < LANES; ++l) {
                const float place = active[l] ? t[l] : near_plane;
                const float here = interpolate(volume, resolution, origin_x + place * dx[l], origin_y + place * dy[l],
                                               origin_z + place * dz[l]);
                const int inside = active[l] & first[l] & (here <= 0.0f);
                const int crossed = active[l] & (here < 0.0f) & !inside;
                hit[l] |= crossed;
                value[l] = crossed ? here : value[l];
                active[l] &= !(crossed | inside);
                step[l] = (active[l] & (here < near_surface)) ? small_step : step[l];
                t[l] += active[l] ? step[l] : 0.0f;
                active[l] &= t[l] < end[l];
                first[l] = 0;
                sampling |= active[l];
            }
        }
    }

    // The crossing between the last two samples, and the gradient there. Compilers think that its loads do not pay.
#pragma clang loop vectorize(enable)
    for (int column = 0; column < width; ++column) {
        const float ray_x = (column - camera.z) / camera.x;
        const float dx = (pose[0] * ray_x + base_x) * per_voxel;
        const float dy = (pose[4] * ray_x + base_y) * per_voxel;
        const float dz = (pose[8] * ray_x + base_z) * per_voxel;
        const float step = steps_taken[column], value = values[column];
        const int crossed = step > 0.0f;
        const float before = crossed ? places[column] - step : near_plane;
        const float earlier = interpolate(volume, resolution, origin_x + before * dx, origin_y + before * dy,
                                          origin_z + before * dz);
        const int falling = crossed & (earlier > value);
        const float place = falling ? before + step * earlier / (earlier - value) : near_plane;
        const float x = origin_x + place * dx, y = origin_y + place * dy, z = origin_z + place * dz;
        const Gradient g = gradient(volume, resolution, x, y, z);
        const float square = g.x * g.x + g.y * g.y + g.z * g.z;
        const int found = falling & (square > 0.0f);
        const float scale = found ? inverse_root(found ? square : 1.0f) : 0.0f;
        const int i = row * width + column;
        vertex_x[i] = found ? (x + 0.5f) * voxel_size : 0.0f;
        vertex_y[i] = found ? (y + 0.5f) * voxel_size : 0.0f;
        vertex_z[i] = found ? (z + 0.5f) * voxel_size : 0.0f;
        normal_x[i] = g.x * scale;
        normal_y[i] = g.y * scale;
        normal_z[i] = g.z * scale;
    }
#endif
}
