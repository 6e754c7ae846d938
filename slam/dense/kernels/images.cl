// From a sensor's depth image to the pyramid that tracking reads.
#include "arithmetic.h"
#include "shape.h"

// Every `ratio`-th pixel, in metres; what does not lie between `nearest` and `farthest` millimetres becomes 0.
kernel void millimetres_to_metres(global const ushort *restrict millimetres, int sensor_width, int ratio, int nearest,
                                  int farthest, global float *restrict metres, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int depth = millimetres[y * ratio * sensor_width + x * ratio];
        metres[y * width + x] = ((depth >= nearest) & (depth <= farthest)) ? depth * 0.001f : 0.0f;
    }
}

#define LOG2_E 1.44269504f

// 2^-t for t >= 0, relative error below 4e-6: a polynomial of the fraction, whose exponent the whole part lowers.
// Plain arithmetic compiles to vector code; a call of exp() does not.
INLINE float power_of_half(float t)
{
    const float exponent = smaller(t, 120.0f);
    const int whole = (int)exponent;
    const float x = exponent - whole;
    const float polynomial =
        0.999997407f +
        x * (-0.693030203f + x * (0.239341077f + x * (-0.0530740686f + x * 0.00676708394f)));
    return as_float(as_int(polynomial) - (whole << 23));
}

// What a neighbour counts for a pixel; nothing where it has no depth. The exponents are of 2.
INLINE float bilateral_weight(float neighbour, float centre, float away, float range_factor)
{
    const float difference = neighbour - centre;
    const float weight = power_of_half(difference * difference * range_factor + away);
    return neighbour > 0.0f ? weight : 0.0f;
}

// One pixel of the filter over 5x5. `inside`: all 25 neighbours exist, so that no index needs a clamp.
INLINE float bilateral(global const float *restrict depth, int width, int height, int x, int y, bool inside,
                       float spatial_factor, float range_factor)
{
    const float centre = depth[y * width + x];
    float sum = 0.0f, weights = 0.0f;
    // Unrolled, so that it is the loop over the row that becomes vector code.
#pragma unroll
    for (int dy = -2; dy <= 2; ++dy) {
        const int row = bounded(y + dy, 0, height - 1) * width;
#pragma unroll
        for (int dx = -2; dx <= 2; ++dx) {
            const int column = inside ? x + dx : bounded(x + dx, 0, width - 1);
            const float neighbour = depth[row + column];
            const float away = (dx * dx + dy * dy) * (spatial_factor * LOG2_E);
            const float weight = bilateral_weight(neighbour, centre, away, range_factor * LOG2_E);
            sum += weight * neighbour;
            weights += weight;
        }
    }
    return centre > 0.0f ? sum / weights : 0.0f;
}

// Tomasi and Manduchi 1998, over 5x5 pixels; factors are 1 / (2 sigma^2). Pixels without depth stay so and count
// nowhere; beyond a side lies what is nearest inside.
kernel void bilateral_filter(global const float *restrict depth, global float *restrict filtered, int width, int height,
                             float spatial_factor, float range_factor)
{
#ifdef PIXELS
    EACH_PIXEL(x, y, width, height)
    {
        filtered[y * width + x] = bilateral(depth, width, height, x, y, false, spatial_factor, range_factor);
    }
#else
    const int y = get_global_id(0);
    const int first = bounded(2, 0, width), last = bounded(width - 2, first, width);
    for (int x = 0; x < first; ++x)
        filtered[y * width + x] = bilateral(depth, width, height, x, y, false, spatial_factor, range_factor);
    for (int x = first; x < last; ++x)
        filtered[y * width + x] = bilateral(depth, width, height, x, y, true, spatial_factor, range_factor);
    for (int x = last; x < width; ++x)
        filtered[y * width + x] = bilateral(depth, width, height, x, y, false, spatial_factor, range_factor);
#endif
}

#ifndef PIXELS
// LANES pixels of a row from `first` on: their sums stay in registers whatever the radius is.
#define LANES 16

INLINE void filter_lanes(global const float *restrict depth, global float *restrict filtered, int width, int height,
                         int y, int first, int down, int radius, float spatial_factor, float range_factor)
{
    float centre[LANES], sum[LANES], weights[LANES];
    const int margin = down ? 0 : radius;
    const int inside = (first >= margin) & (first + LANES + margin <= width);
    for (int l = 0; l < LANES; ++l) {
        centre[l] = depth[y * width + bounded(first + l, 0, width - 1)];
        sum[l] = weights[l] = 0.0f;
    }
    for (int d = -radius; d <= radius; ++d) {
        const int row = (down ? bounded(y + d, 0, height - 1) : y) * width, start = first + (down ? 0 : d);
        const float away = d * d * (spatial_factor * LOG2_E);
        if (inside) // written twice, since compilers do not make two loops of one themselves
            for (int l = 0; l < LANES; ++l) {
                const float neighbour = depth[row + start + l];
                const float weight = bilateral_weight(neighbour, centre[l], away, range_factor * LOG2_E);
                sum[l] += weight * neighbour;
                weights[l] += weight;
            }
        else
            for (int l = 0; l < LANES; ++l) {
                const float neighbour = depth[row + bounded(start + l, 0, width - 1)];
                const float weight = bilateral_weight(neighbour, centre[l], away, range_factor * LOG2_E);
                sum[l] += weight * neighbour;
                weights[l] += weight;
            }
    }
    for (int l = 0; l < LANES; ++l)
        if (first + l < width)
            filtered[y * width + first + l] = centre[l] > 0.0f ? sum[l] / weights[l] : 0.0f;
}
#endif

// The same over the 2 radius + 1 pixels of a line, along the row or, where `down`, along the column. One after the other
// they come close to the filter over (2 radius + 1)^2 pixels, for a small part of its work (Pham and van Vliet 2005).
kernel void bilateral_filter_line(global const float *restrict depth, global float *restrict filtered, int width,
                                  int height, int down, int radius, float spatial_factor, float range_factor)
{
#ifdef PIXELS
    EACH_PIXEL(x, y, width, height)
    {
        const float centre = depth[y * width + x];
        float sum = 0.0f, weights = 0.0f;
        for (int d = -radius; d <= radius; ++d) {
            const int row = bounded(down ? y + d : y, 0, height - 1), column = bounded(down ? x : x + d, 0, width - 1);
            const float neighbour = depth[row * width + column];
            const float away = d * d * (spatial_factor * LOG2_E);
            const float weight = bilateral_weight(neighbour, centre, away, range_factor * LOG2_E);
            sum += weight * neighbour;
            weights += weight;
        }
        filtered[y * width + x] = centre > 0.0f ? sum / weights : 0.0f;
    }
#else
    const int y = get_global_id(0);
    for (int first = 0; first < width; first += LANES)
        filter_lanes(depth, filtered, width, height, y, first, down, radius, spatial_factor, range_factor);
#endif
}

// Half the size: the mean of those of a 2x2 block that lie within `range` of its first pixel.
kernel void half_sample(global const float *restrict fine, int fine_width, global float *restrict coarse, int width,
                        int height, float range)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int corner = 2 * y * fine_width + 2 * x;
        const float centre = fine[corner];
        const float a = fine[corner + 1], b = fine[corner + fine_width], c = fine[corner + fine_width + 1];
        const float use_a = magnitude(a - centre) < range ? 1.0f : 0.0f;
        const float use_b = magnitude(b - centre) < range ? 1.0f : 0.0f;
        const float use_c = magnitude(c - centre) < range ? 1.0f : 0.0f;
        coarse[y * width + x] = (centre + use_a * a + use_b * b + use_c * c) / (1.0f + use_a + use_b + use_c);
    }
}

// Unit normals towards the camera from central differences of the vertex map; zero where one of the
// five pixels has no depth. `camera` is (fx, fy, cx, cy); a mirrored camera has fy < 0.
kernel void normal_map(global const float *restrict depth, global float *restrict normal_x,
                       global float *restrict normal_y, global float *restrict normal_z, int width, int height,
                       float4 camera)
{
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    const float side = camera.x * camera.y > 0.0f ? 1.0f : -1.0f;
    EACH_PIXEL(x, y, width, height)
    {
        const int above = bounded(y - 1, 0, height - 1), below = bounded(y + 1, 0, height - 1);
        const int left = bounded(x - 1, 0, width - 1), right = bounded(x + 1, 0, width - 1);
        const float here = depth[y * width + x];
        const float l = depth[y * width + left], r = depth[y * width + right];
        const float u = depth[above * width + x], d = depth[below * width + x];
        const float ray_x = (x - camera.z) * inverse_fx, ray_y = (y - camera.w) * inverse_fy;
        const float ax = ((right - camera.z) * r - (left - camera.z) * l) * inverse_fx;
        const float ay = ray_y * (r - l), az = r - l;
        const float bx = ray_x * (d - u), bz = d - u;
        const float by = ((below - camera.w) * d - (above - camera.w) * u) * inverse_fy;
        const float nx = side * (by * az - bz * ay);
        const float ny = side * (bz * ax - bx * az);
        const float nz = side * (bx * ay - by * ax);
        const float square = nx * nx + ny * ny + nz * nz;
        const int valid = (here > 0.0f) & (l > 0.0f) & (r > 0.0f) & (u > 0.0f) & (d > 0.0f) & (square > 0.0f);
        const float scale = valid ? inverse_root(valid ? square : 1.0f) : 0.0f;
        normal_x[y * width + x] = nx * scale;
        normal_y[y * width + x] = ny * scale;
        normal_z[y * width + x] = nz * scale;
    }
}
