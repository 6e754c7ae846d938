// Registers one RGB-D image to another: point-to-plane distances and differences of brightness together
// (Whelan et al. 2016, section 3.2).
#include "arithmetic.h"
#include "least_squares.h"
#include "association.h"
#include "motion.h"

// What a registration keeps on the device between its iterations; `odometry.py` holds the same layout.
typedef struct {
    float pose[12];          // source camera to target camera, 3x4 row by row, metres
    float normal_matrix[21]; // upper triangle, of the iteration solved last, as are the sums below
    float icp_squared_error, icp_inliers;
    float rgb_squared_error, rgb_inliers;
    float noise;             // root mean square of the differences of brightness
    int converged;           // the current level needs no further iteration
} Estimate;

// Lists, row by row, the columns of the pixels whose brightness says something of the motion: steep enough, with a
// depth. It depends on no pose. One work-item per row.
kernel void list_steep_pixels(global const float *restrict depth, global const float *restrict gradient_x,
                              global const float *restrict gradient_y, int width, float least_gradient, float farthest,
                              global int *restrict columns, global int *restrict counts)
{
    const int y = get_global_id(0);
    int count = 0;
    for (int x = 0; x < width; ++x) {
        const int i = y * width + x;
        const float square = gradient_x[i] * gradient_x[i] + gradient_y[i] * gradient_y[i];
        columns[y * width + count] = x;
        count += (square >= least_gradient * least_gradient) & (depth[i] > 0.0f) & (depth[i] <= farthest);
    }
    counts[y] = count;
}

// The pixels listed above, shared out as EACH_SUMMED does with all of them; the column stands at columns[i].
#ifdef PIXELS
#define EACH_LISTED(i, y, width, height, counts)                                                                       \
    for (int i = get_global_id(0), y; y = i / (width), i < (width) * (height); i += get_global_size(0))                \
        if (i - y * (width) < counts[y])
#else
#define EACH_LISTED(i, y, width, height, counts)                                                                       \
    const int y = get_global_id(0);                                                                                    \
    for (int i = y * (width); i < y * (width) + counts[y]; ++i)
#endif

// The normal equations of both errors. A point of the source is moved by the pose and compared with the target's pixel
// that it falls upon: distance along that pixel's normal, weighted with `icp_weight`; and brightness, weighted with
// rgb_weight / (noise + |difference|). Between the target's pixels brightness is what its gradient says; how it changes
// with the pose is the mean of both images' gradients, which is good to second order (Malis 2004). A weight of 0 leaves
// an error out.
SUM_GROUP_SIZE
kernel void equations(global const float *restrict depth, global const float *restrict normal_x,
                      global const float *restrict normal_y, global const float *restrict normal_z,
                      global const float *restrict intensity, global const float *restrict gradient_x,
                      global const float *restrict gradient_y, int width, int height, float4 camera,
                      global const float *restrict target_depth, global const float *restrict target_normal_x,
                      global const float *restrict target_normal_y, global const float *restrict target_normal_z,
                      global const float *restrict target_intensity, global const float *restrict target_gradient_x,
                      global const float *restrict target_gradient_y, int target_width, int target_height,
                      float4 target_camera, global const int *restrict columns, global const int *restrict counts,
                      float icp_weight, float rgb_weight, float max_distance, float min_dot,
                      float max_depth_difference, int iteration, global const Estimate *restrict estimate,
                      global float *restrict records)
{
    if (iteration > 0 && estimate->converged)
        return;
    float pose[12];
    for (int k = 0; k < 12; ++k)
        pose[k] = estimate->pose[k];
    const float noise = estimate->noise;
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    const float target_inverse_fx = 1.0f / target_camera.x, target_inverse_fy = 1.0f / target_camera.y;
    DECLARE_SUMS
    if (icp_weight > 0.0f) {
        EACH_SUMMED(i, x, y, width, height)
        {
            const float z = depth[i];
            const Vector point =
                moved(pose, vector((x - camera.z) * inverse_fx * z, (y - camera.w) * inverse_fy * z, z));
            const Vector normal = turned(pose, vector(normal_x[i], normal_y[i], normal_z[i]));
            const Pixel pixel = nearest_pixel(target_camera.x * point.x + target_camera.z * point.z,
                                              target_camera.y * point.y + target_camera.w * point.z, point.z,
                                              target_width, target_height);
            const int t = pixel.line * target_width + pixel.column;
            const float tz = target_depth[t];
            const Vector target = vector((pixel.column - target_camera.z) * target_inverse_fx * tz,
                                         (pixel.line - target_camera.w) * target_inverse_fy * tz, tz);
            const Equation equation = point_to_plane(
                pixel.visible & (tz > 0.0f), point, normal, target,
                vector(target_normal_x[t], target_normal_y[t], target_normal_z[t]), max_distance, min_dot);
            ACCUMULATE(equation)
        }
        const float factor = icp_weight * icp_weight;
        SCALE_ROWS(factor)
    }
    if (rgb_weight > 0.0f) {
        EACH_LISTED(i, y, width, height, counts)
        {
            const int x = columns[i], s = y * width + x;
            const float z = depth[s];
            const Vector point =
                moved(pose, vector((x - camera.z) * inverse_fx * z, (y - camera.w) * inverse_fy * z, z));
            const float across = target_camera.x * point.x + target_camera.z * point.z;
            const float along = target_camera.y * point.y + target_camera.w * point.z;
            const Pixel pixel = nearest_pixel(across, along, point.z, target_width, target_height);
            const int t = pixel.line * target_width + pixel.column;
            const float tz = target_depth[t], brightness = target_intensity[t];
            const float gx = 0.5f * (gradient_x[s] + target_gradient_x[t]);
            const float gy = 0.5f * (gradient_y[s] + target_gradient_y[t]);
            const float inverse = pixel.visible ? 1.0f / point.z : 0.0f;
            const float beyond_x = across * inverse - pixel.column, beyond_y = along * inverse - pixel.line;
            const float expected = brightness + target_gradient_x[t] * beyond_x + target_gradient_y[t] * beyond_y;
            const int inlier = pixel.visible & (tz > 0.0f) & (brightness > 0.0f) &
                               (magnitude(tz - point.z) <= max_depth_difference);
            const float difference = inlier ? intensity[s] - expected : 0.0f;
            const float w = inlier ? rgb_weight / (noise + magnitude(difference)) : 0.0f;

            const float sx = w * gx * target_camera.x * inverse, sy = w * gy * target_camera.y * inverse;
            const float sz = -(sx * point.x + sy * point.y) * inverse;
            Equation equation;
            equation.j0 = sx;
            equation.j1 = sy;
            equation.j2 = sz;
            equation.j3 = point.y * sz - point.z * sy;
            equation.j4 = point.z * sx - point.x * sz;
            equation.j5 = point.x * sy - point.y * sx;
            equation.error = w * difference;
            ACCUMULATE_ROW(equation)
            s29 += difference * difference;
            s30 += inlier ? 1.0f : 0.0f;
        }
    }
    LEAVE_RECORD(records)
}

#define LEAST_NOISE 1.0f // a grey level: the resolution of colours

INLINE float noise_of(real squared_error, real inliers)
{
    return larger(inliers > 0 ? sqrt(squared_error / inliers) : 0, LEAST_NOISE);
}

// Only takes the noise from the records, which an iteration needs before it can weigh anything.
kernel void measure_noise(global const float *restrict records, int count, global Estimate *restrict estimate)
{
    real total[SUMS];
    sum_records(records, count, total);
    estimate->noise = noise_of(total[29], total[30]);
}

// Sums the records, solves for the twist and moves the pose by it.
kernel void solve(global const float *restrict records, int count, float threshold, int iteration,
                  global Estimate *restrict estimate)
{
    if (iteration > 0 && estimate->converged)
        return;
    real total[SUMS], x[6];
    sum_records(records, count, total);
    solve_symmetric(total, x);
    move_pose(x, estimate->pose);
    estimate->converged = norm_of(x) < threshold;
    for (int k = 0; k < 21; ++k)
        estimate->normal_matrix[k] = total[k];
    estimate->icp_squared_error = total[27];
    estimate->icp_inliers = total[28];
    estimate->rgb_squared_error = total[29];
    estimate->rgb_inliers = total[30];
    estimate->noise = noise_of(total[29], total[30]);
}
