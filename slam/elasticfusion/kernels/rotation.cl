// How far the camera has turned between two images, by their brightness alone (Whelan et al. 2016, section 3.2).
#include "arithmetic.h"
#include "least_squares.h"
#include "association.h"
#include "motion.h"

// What an alignment keeps on the device between its iterations; `rotation.py` holds the same layout.
typedef struct {
    float pose[12];  // the present camera's axes in those of the earlier one, 3x4 row by row; it moves nowhere
    float best[12];  // the pose with the least error so far
    float error;     // its mean squared difference
    float overlap;   // pixels that took part where the alignment started
    int ended;       // the last iteration made it no better
} Alignment;

// The normal equations of the differences of brightness. Seen far away a turn moves each pixel's ray and nothing
// else, so a row has no part that depends on a translation. What lies between pixels is as the gradient says, and
// that is the mean of both images'.
SUM_GROUP_SIZE
kernel void so3_linearise(global const float *restrict intensity, global const float *restrict gradient_x,
                          global const float *restrict gradient_y, global const float *restrict earlier_intensity,
                          global const float *restrict earlier_gradient_x,
                          global const float *restrict earlier_gradient_y, int width, int height, float4 camera,
                          global const Alignment *restrict alignment, global float *restrict records)
{
    if (alignment->ended)
        return;
    float pose[12];
    for (int k = 0; k < 12; ++k)
        pose[k] = alignment->pose[k];
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    DECLARE_SUMS
    EACH_SUMMED(i, x, y, width, height)
    {
        const Vector ray = turned(pose, vector((x - camera.z) * inverse_fx, (y - camera.w) * inverse_fy, 1.0f));
        const float across = camera.x * ray.x + camera.z * ray.z, along = camera.y * ray.y + camera.w * ray.z;
        const Pixel pixel = nearest_pixel(across, along, ray.z, width, height);
        const int e = pixel.line * width + pixel.column;
        const float earlier = earlier_intensity[e];
        const float inverse = pixel.visible ? 1.0f / ray.z : 0.0f;
        const float beyond_x = across * inverse - pixel.column, beyond_y = along * inverse - pixel.line;
        const float gx = 0.5f * (gradient_x[i] + earlier_gradient_x[e]);
        const float gy = 0.5f * (gradient_y[i] + earlier_gradient_y[e]);
        const float expected = earlier + earlier_gradient_x[e] * beyond_x + earlier_gradient_y[e] * beyond_y;
        const float w = (pixel.visible & (intensity[i] > 0.0f) & (earlier > 0.0f)) ? 1.0f : 0.0f;
        const float sx = w * gx * camera.x * inverse, sy = w * gy * camera.y * inverse;
        const float sz = -(sx * ray.x + sy * ray.y) * inverse;
        Equation equation;
        equation.j0 = equation.j1 = equation.j2 = 0.0f;
        equation.j3 = ray.y * sz - ray.z * sy;
        equation.j4 = ray.z * sx - ray.x * sz;
        equation.j5 = ray.x * sy - ray.y * sx;
        equation.error = w * (intensity[i] - expected);
        equation.weight = w;
        ACCUMULATE(equation)
    }
    LEAVE_RECORD(records)
}

// Keeps the present turn if it is the best so far, with most of the overlap left, and moves on from it; ends otherwise.
kernel void turn(global const float *restrict records, int count, float least_overlap,
                 global Alignment *restrict alignment)
{
    if (alignment->ended)
        return;
    real total[SUMS], x[6];
    sum_records(records, count, total);
    const int first = alignment->overlap == 0.0f;
    if (first)
        alignment->overlap = total[28];
    const float error = total[28] > 0 ? total[27] / total[28] : 0;
    const int better = first | ((error < alignment->error) & (total[28] >= least_overlap * alignment->overlap));
    alignment->ended = !better | !(total[28] > 0);
    if (alignment->ended)
        return;
    alignment->error = error;
    for (int k = 0; k < 12; ++k)
        alignment->best[k] = alignment->pose[k];
    solve_symmetric(total, x);
    move_pose(x, alignment->pose);
}
