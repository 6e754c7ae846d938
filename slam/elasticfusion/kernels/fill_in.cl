// Joins what the model predicts with what the sensor sees, and takes samples of an image.
#include "arithmetic.h"
#include "shape.h"

// The prediction where it is kept and, if `holes` are filled, exists; the live image elsewhere: geometry by depth,
// colour by colour.
kernel void fill_in(global const float *restrict predicted_depth, global const float *restrict predicted_normal_x,
                    global const float *restrict predicted_normal_y, global const float *restrict predicted_normal_z,
                    global const uint *restrict predicted_colour, global const float *restrict live_depth,
                    global const float *restrict live_normal_x, global const float *restrict live_normal_y,
                    global const float *restrict live_normal_z, global const uint *restrict live_colour,
                    global float *restrict depth, global float *restrict normal_x, global float *restrict normal_y,
                    global float *restrict normal_z, global uint *restrict colour, int width, int height,
                    int keep_depth, int keep_colour, int holes)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int i = y * width + x;
        const int predicted = keep_depth & ((predicted_depth[i] > 0.0f) | !holes);
        const int painted = keep_colour & ((predicted_colour[i] != 0) | !holes);
        depth[i] = predicted ? predicted_depth[i] : live_depth[i];
        normal_x[i] = predicted ? predicted_normal_x[i] : live_normal_x[i];
        normal_y[i] = predicted ? predicted_normal_y[i] : live_normal_y[i];
        normal_z[i] = predicted ? predicted_normal_z[i] : live_normal_z[i];
        colour[i] = painted ? predicted_colour[i] : live_colour[i];
    }
}

// The pixel in the middle of each block of `ratio` x `ratio`.
kernel void sample_image(global const float *restrict fine_depth, global const float *restrict fine_normal_x,
                         global const float *restrict fine_normal_y, global const float *restrict fine_normal_z,
                         global const uint *restrict fine_colour, int fine_width, int ratio,
                         global float *restrict depth, global float *restrict normal_x,
                         global float *restrict normal_y, global float *restrict normal_z,
                         global uint *restrict colour, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int i = y * width + x, fine = (y * ratio + ratio / 2) * fine_width + x * ratio + ratio / 2;
        depth[i] = fine_depth[fine];
        normal_x[i] = fine_normal_x[fine];
        normal_y[i] = fine_normal_y[fine];
        normal_z[i] = fine_normal_z[fine];
        colour[i] = fine_colour[fine];
    }
}
