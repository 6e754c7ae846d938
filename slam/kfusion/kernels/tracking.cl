// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5).
#include "arithmetic.h"
#include "least_squares.h"
#include "association.h"
#include "motion.h"

// The parts of the normal equations of an image, one record of SUMS floats per work-group.
SUM_GROUP_SIZE
kernel void track(global const float *restrict depth, global const float *restrict normal_x,
                  global const float *restrict normal_y, global const float *restrict normal_z, int width, int height,
                  float4 camera, global const float *restrict model_x, global const float *restrict model_y,
                  global const float *restrict model_z, global const float *restrict model_normal_x,
                  global const float *restrict model_normal_y, global const float *restrict model_normal_z,
                  int model_width, int model_height, float max_distance, float min_dot, int conditional,
                  global const State *restrict state, global float *restrict records)
{
    if (conditional && !state->iterating)
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

// Sums the records, solves for the twist and moves the pose by it. Rows: one work-item. Pixels: one group, of which each
// work-item sums one float of its share of the records.
#ifdef PIXELS
__attribute__((reqd_work_group_size(SOLVERS, 1, 1)))
#endif
kernel void solve(global const float *restrict records, int count, float threshold, int conditional,
                  global State *restrict state)
{
    if (conditional && !state->iterating)
        return;
    real total[SUMS], x[6];
#ifdef PIXELS
    local float part[SOLVERS];
    const int me = get_local_id(0);
    float sum = 0.0f;
    for (int record = me / SUMS; record < count; record += SOLVERS / SUMS)
        sum += records[record * SUMS + me % SUMS];
    part[me] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (me > 0)
        return;
    for (int k = 0; k < SUMS; ++k) {
        total[k] = 0;
        for (int other = k; other < SOLVERS; other += SUMS)
            total[k] += part[other];
    }
#else
    sum_records(records, count, total);
#endif
    solve_symmetric(total, x);
    move_pose(x, state->pose);
    state->iterating = !(norm_of(x) < threshold);
    state->squared_error = total[27];
    state->inliers = total[28];
    for (int k = 0; k < 21; ++k)
        state->normal_matrix[k] = total[k];
}

// Remembers where the frame started, and which pixels the model belongs to, which was seen from there: intrinsics times
// the inverse of the pose.
kernel void begin_tracking(float4 camera, global State *state)
{
    for (int i = 0; i < 12; ++i)
        state->previous[i] = state->pose[i];
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

// Whether a pose's position lies in the volume, a cube of `size` metres whose corner is the origin.
INLINE int in_volume(global const float *restrict pose, float size)
{
    return pose[3] >= 0.0f && pose[3] <= size && pose[7] >= 0.0f && pose[7] <= size && pose[11] >= 0.0f &&
           pose[11] <= size;
}

// Keeps the new pose when the residual is small, enough of the level solved last took part, and the camera can have moved
// so; otherwise goes back to where the frame started. `max_translation` (m) and `max_rotation` (rad) are for one check, and
// grow with the checks missed. A motion beyond `near_motion` (m + rad) needs the share `far_inliers` and, unless checks were
// missed, the part `kept_inliers` of the share at the last check that passed. The camera may not leave the volume.
// Written so that NaN fails.
kernel void check_pose(int pixels, float max_residual, float min_inliers, float near_motion, float far_inliers,
                       float kept_inliers, float max_translation, float max_rotation, float volume_size,
                       global State *state)
{
    const float x = state->pose[3] - state->previous[3], y = state->pose[7] - state->previous[7];
    const float z = state->pose[11] - state->previous[11];
    const float translation = sqrt(x * x + y * y + z * z);
    float trace = 0.0f;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            trace += state->pose[4 * row + column] * state->previous[4 * row + column];
    const float rotation = acos(larger(smaller(0.5f * (trace - 1.0f), 1.0f), -1.0f));
    const float checks = state->misses + 1, inliers = state->inliers / pixels;
    const float kept = state->misses > 0 ? 0.0f : kept_inliers * state->last_inliers;
    const float needed = translation + rotation > near_motion ? larger(far_inliers, kept) : min_inliers;
    const int good = sqrt(state->squared_error / state->inliers) <= max_residual && inliers >= needed &&
                     translation <= max_translation * checks && rotation <= max_rotation * checks &&
                     (in_volume(state->pose, volume_size) || !in_volume(state->previous, volume_size));
    state->tracked = good;
    state->misses = good ? 0 : state->misses + 1;
    if (good)
        state->last_inliers = inliers;
    else
        for (int i = 0; i < 12; ++i)
            state->pose[i] = state->previous[i];
}
