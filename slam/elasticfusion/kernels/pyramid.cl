// The levels of an RGB-D image that a registration reads.
#include "arithmetic.h"
#include "shape.h"

// Brightness from 0 to 255 (ITU-R BT.601); 0 where there is no colour.
kernel void intensity(global const uint *restrict colour, global float *restrict brightness, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const uint c = colour[y * width + x];
        brightness[y * width + x] =
            (int)(c & 255) * 0.299f + (int)((c >> 8) & 255) * 0.587f + (int)((c >> 16) & 255) * 0.114f;
    }
}

// Half the size: 4x4 binomial weights around the middle of a 2x2 block, over the pixels that have a brightness.
kernel void half_sample_intensity(global const float *restrict fine, int fine_width, int fine_height,
                                  global float *restrict coarse, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        float sum = 0.0f, weights = 0.0f;
#pragma unroll
        for (int dy = 0; dy < 4; ++dy) {
            const int row = bounded(2 * y + dy - 1, 0, fine_height - 1) * fine_width;
#pragma unroll
            for (int dx = 0; dx < 4; ++dx) {
                const float value = fine[row + bounded(2 * x + dx - 1, 0, fine_width - 1)];
                const float weight = ((dx == 1 || dx == 2) ? 3.0f : 1.0f) * ((dy == 1 || dy == 2) ? 3.0f : 1.0f);
                const float counted = value > 0.0f ? weight : 0.0f;
                sum += counted * value;
                weights += counted;
            }
        }
        coarse[y * width + x] = weights > 0.0f ? sum / weights : 0.0f;
    }
}

// The mean direction of those normals of a 2x2 block whose depth lies within `range` of its first pixel, which is how
// the depth of the block is made.
kernel void half_sample_normals(global const float *restrict depth, global const float *restrict fine_x,
                                global const float *restrict fine_y, global const float *restrict fine_z,
                                int fine_width, global float *restrict normal_x, global float *restrict normal_y,
                                global float *restrict normal_z, int width, int height, float range)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int corner = 2 * y * fine_width + 2 * x, below = corner + fine_width;
        const float centre = depth[corner];
        const float a = magnitude(depth[corner + 1] - centre) < range ? 1.0f : 0.0f;
        const float b = magnitude(depth[below] - centre) < range ? 1.0f : 0.0f;
        const float c = magnitude(depth[below + 1] - centre) < range ? 1.0f : 0.0f;
        const float nx = fine_x[corner] + a * fine_x[corner + 1] + b * fine_x[below] + c * fine_x[below + 1];
        const float ny = fine_y[corner] + a * fine_y[corner + 1] + b * fine_y[below] + c * fine_y[below + 1];
        const float nz = fine_z[corner] + a * fine_z[corner + 1] + b * fine_z[below] + c * fine_z[below + 1];
        const float square = nx * nx + ny * ny + nz * nz;
        const int valid = (centre > 0.0f) & (square > 0.0f);
        const float scale = valid ? inverse_root(valid ? square : 1.0f) : 0.0f;
        normal_x[y * width + x] = nx * scale;
        normal_y[y * width + x] = ny * scale;
        normal_z[y * width + x] = nz * scale;
    }
}

// Brightness per pixel to the right and down, by a smoothed derivative over 3x3 pixels; 0 at the image's sides and
// where one of the nine has no brightness.
#define DIAGONAL 0.1419640f // of the weights 0.52201 and 0.79451, whose slope over a plane would be 3.67706
#define STRAIGHT 0.2160721f

kernel void gradient(global const float *restrict brightness, global float *restrict gradient_x,
                     global float *restrict gradient_y, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int above = bounded(y - 1, 0, height - 1) * width, below = bounded(y + 1, 0, height - 1) * width;
        const int left = bounded(x - 1, 0, width - 1), right = bounded(x + 1, 0, width - 1), here = y * width;
        const float a = brightness[above + left], b = brightness[above + x], c = brightness[above + right];
        const float d = brightness[here + left], e = brightness[here + x], f = brightness[here + right];
        const float g = brightness[below + left], h = brightness[below + x], i = brightness[below + right];
        const int valid = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1) & (a > 0.0f) & (b > 0.0f) &
                          (c > 0.0f) & (d > 0.0f) & (e > 0.0f) & (f > 0.0f) & (g > 0.0f) & (h > 0.0f) & (i > 0.0f);
        gradient_x[here + x] = valid ? DIAGONAL * (c - a + i - g) + STRAIGHT * (f - d) : 0.0f;
        gradient_y[here + x] = valid ? DIAGONAL * (g - a + i - c) + STRAIGHT * (h - b) : 0.0f;
    }
}
