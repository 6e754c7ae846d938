// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5).
#include "arithmetic.h"
#include "least_squares.h"
#include "association.h"
#include "motion.h"
#include "state.h"

// The parts of the normal equations of an image, one record of SUMS floats per work-group.
SUM_GROUP_SIZE
kernel void track(global const float *restrict depth, global const float *restrict normal_x,
                  global const float *restrict normal_y, global const float *restrict normal_z, int width, int height,
                  float4 camera, global const float *restrict model_x, global const float *restrict model_y,
                  global const float *restrict model_z, global const float *restrict model_normal_x,
                  global const float *restrict model_normal_y, global const float *restrict model_normal_z,
                  int model_width, int model_height, float max_distance, float min_dot, int iteration,
                  global const State *restrict state, global float *restrict records)
{
    if (iteration > 0 && state->converged)
        return;
    float pose[12], view[12];
    for (int k = 0; k < 12; ++k) {
        pose[k] = state->pose[k];
        view[k] = state->view[k];
    }
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    DECLARE_SUMS
    EACH_SUMMED(i, x, y, width, height)
    {
        const float z = depth[i];
        const Vector point = moved(pose, vector((x - camera.z) * inverse_fx * z, (y - camera.w) * inverse_fy * z, z));
        const Vector normal = turned(pose, vector(normal_x[i], normal_y[i], normal_z[i]));
        const Vector seen = moved(view, point);
        const Pixel pixel = nearest_pixel(seen.x, seen.y, seen.z, model_width, model_height);
        const int m = pixel.line * model_width + pixel.column;
        const Equation equation =
            point_to_plane(pixel.visible, point, normal, vector(model_x[m], model_y[m], model_z[m]),
                           vector(model_normal_x[m], model_normal_y[m], model_normal_z[m]), max_distance, min_dot);
        ACCUMULATE(equation)
    }
    LEAVE_RECORD(records)
}

// Sums the records, solves for the twist and moves the pose by it.
kernel void solve(global const float *restrict records, int count, float threshold, int iteration,
                  global State *restrict state)
{
    if (iteration > 0 && state->converged)
        return;
    real total[SUMS], x[6];
    sum_records(records, count, total);
    solve_symmetric(total, x);
    move_pose(x, state->pose);
    state->converged = norm_of(x) < threshold;
    state->squared_error = total[27];
    state->inliers = total[28];
}

// Remembers where the frame started.
kernel void begin_tracking(global State *state)
{
    for (int i = 0; i < 12; ++i)
        state->previous[i] = state->pose[i];
}

// Keeps the new pose when the residual is small and enough of the level solved last took part; otherwise
// goes back to where the frame started. Written so that NaN fails.
kernel void check_pose(int pixels, float max_residual, float min_inliers, global State *state)
{
    const int good = sqrt(state->squared_error / state->inliers) <= max_residual &&
                     state->inliers / pixels >= min_inliers;
    state->tracked = good;
    if (!good)
        for (int i = 0; i < 12; ++i)
            state->pose[i] = state->previous[i];
}
