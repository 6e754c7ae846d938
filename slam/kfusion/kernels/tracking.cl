// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5).
#include "arithmetic.h"
#include "least_squares.h"
#include "association.h"
#include "motion.h"
#include "turning.h"

// Whether a launch has something to do: WHILE_ITERATING while the level needs another iteration, WHILE_RETRYING in a frame's
// second attempt.
INLINE int wanted(int conditional, global const State *restrict state)
{
    return (!(conditional & WHILE_ITERATING) || state->iterating) && (!(conditional & WHILE_RETRYING) || state->retrying);
}

// Adds to the normal equations that the camera stays where ICP started: a metre or a radian away costs as much as an error
// of sqrt(`prior`) m of every inlier. It decides where the image does not, as along a flat wall, and fades with the checks
// missed.
static inline void add_prior(float prior, global const State *restrict state, real total[SUMS])
{
    const real checks = state->misses + 1, weight = prior * total[28] / (checks * checks);
    const real x = state->pose[3], y = state->pose[7], z = state->pose[11];
    // The twist (v, w) about the volume's corner moves the camera by v + w x position.
    const real rows[6][6] = {{1, 0, 0, 0, z, -y}, {0, 1, 0, -z, 0, x}, {0, 0, 1, y, -x, 0},
                             {0, 0, 0, 1, 0, 0},  {0, 0, 0, 0, 1, 0},  {0, 0, 0, 0, 0, 1}};
    float turn[3];
    rotation_between(state->start, state->pose, turn);
    for (int row = 0; row < 6; ++row) {
        const real away = row < 3 ? state->pose[4 * row + 3] - state->start[4 * row + 3] : turn[row - 3];
        for (int i = 0, k = 0; i < 6; ++i) {
            total[21 + i] -= weight * rows[row][i] * away;
            for (int j = i; j < 6; ++j, ++k)
                total[k] += weight * rows[row][i] * rows[row][j];
        }
    }
}

// An image to track, and the model that it is compared with.
#define TRACKED                                                                                                        \
    global const float *restrict depth, global const float *restrict normal_x, global const float *restrict normal_y,  \
        global const float *restrict normal_z, int width, int height, float4 camera,                                   \
        global const float *restrict model_x, global const float *restrict model_y,                                    \
        global const float *restrict model_z, global const float *restrict model_normal_x,                             \
        global const float *restrict model_normal_y, global const float *restrict model_normal_z, int model_width,     \
        int model_height, float max_distance, float min_dot

// Adds pixel `i` at (x, y) to the sums; s29 counts the pixels that see the model.
#define SUM_PIXEL(i, x, y)                                                                                             \
    const float z = depth[i];                                                                                          \
    const Vector point = moved(pose, vector((x - camera.z) * inverse_fx * z, (y - camera.w) * inverse_fy * z, z));     \
    const Vector normal = turned(pose, vector(normal_x[i], normal_y[i], normal_z[i]));                                 \
    const Vector seen = moved(view, point);                                                                            \
    const Pixel pixel = nearest_pixel(seen.x, seen.y, seen.z, model_width, model_height);                              \
    const int m = pixel.line * model_width + pixel.column;                                                             \
    const Vector model_normal = vector(model_normal_x[m], model_normal_y[m], model_normal_z[m]);                       \
    const Equation equation = point_to_plane(                                                                          \
        pixel.visible, point, normal, vector(model_x[m], model_y[m], model_z[m]), model_normal, max_distance, min_dot); \
    ACCUMULATE(equation)                                                                                               \
    s29 += pixel.visible & (z > 0.0f) & (dot_product(model_normal, model_normal) > 0.0f) ? 1.0f : 0.0f;

// What SUM_PIXEL needs of the state.
#define DECLARE_VIEW                                                                                                   \
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;                                            \
    float pose[12], view[12];                                                                                          \
    for (int k = 0; k < 12; ++k) {                                                                                     \
        pose[k] = state->pose[k];                                                                                      \
        view[k] = state->view[k];                                                                                      \
    }

// The parts of the normal equations of an image, one record of SUMS floats per work-group.
SUM_GROUP_SIZE
kernel void track(TRACKED, int conditional, global const State *restrict state, global float *restrict records)
{
    if (!wanted(conditional, state))
        return;
    DECLARE_VIEW
    DECLARE_SUMS
    EACH_SUMMED(i, x, y, width, height)
    {
        SUM_PIXEL(i, x, y)
    }
    LEAVE_RECORD(records)
}

// Sums the records, solves for the twist and moves the pose by it. Rows: one work-item. Pixels: one group, of which each
// work-item sums one float of its share of the records. `prior`: see add_prior; it counts while the camera recovers.
#ifdef PIXELS
__attribute__((reqd_work_group_size(SOLVERS, 1, 1)))
#endif
kernel void solve(global const float *restrict records, int count, float threshold, float prior, int conditional,
                  global State *restrict state)
{
    if (!wanted(conditional, state))
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
    state->squared_error = total[27];
    state->inliers = total[28];
    state->overlap = total[29];
    for (int k = 0; k < 21; ++k)
        state->normal_matrix[k] = total[k];
    if (state->recovering && !state->retrying)
        add_prior(prior, state, total);
    solve_symmetric(total, x);
    move_pose(x, state->pose);
    state->iterating = !(norm_of(x) < threshold);
}

#ifndef PIXELS
// All iterations of a level whose image is small, by one work-item: as `track` and `solve` in turn, without their launches.
kernel void iterate(TRACKED, int iterations, float threshold, float prior, int conditional, global State *state,
                    global float *records)
{
    for (int iteration = 0; iteration < iterations; ++iteration) {
        if (!wanted(iteration ? conditional | WHILE_ITERATING : conditional, state))
            return;
        DECLARE_VIEW
        for (int y = 0; y < height; ++y) {
            global float *restrict record = records + y * SUMS;
            DECLARE_SUMS
            for (int x = 0, i = y * width; x < width; ++x, ++i) {
                SUM_PIXEL(i, x, y)
            }
            COLLECT(record)
        }
        solve(records, height, threshold, prior, conditional, state);
    }
}
#endif

// After a raycast, where rays are not cast after every frame: which pixels the model belongs to, which is seen from here.
// That is intrinsics times the inverse of the pose.
kernel void keep_view(float4 camera, global State *state)
{
    const float t[3] = {state->pose[3], state->pose[7], state->pose[11]};
    for (int column = 0; column < 4; ++column) {
        float inverse[3];
        for (int i = 0; i < 3; ++i)
            inverse[i] = column < 3 ? state->pose[4 * column + i]
                                    : -(state->pose[i] * t[0] + state->pose[4 + i] * t[1] + state->pose[8 + i] * t[2]);
        state->view[column] = camera.x * inverse[0] + camera.z * inverse[2];
        state->view[4 + column] = camera.y * inverse[1] + camera.w * inverse[2];
        state->view[8 + column] = inverse[2];
    }
}

// Remembers where the frame started. While the camera recovers, ICP starts where its last turn leads, believed to go on for
// `most_extrapolated` checks. The model is seen from where the last view was kept.
kernel void begin_at_view(int most_extrapolated, global State *state)
{
    for (int i = 0; i < 12; ++i)
        state->previous[i] = state->pose[i];
    state->retrying = 0;
    if (state->recovering && state->misses < most_extrapolated) {
        const float checks = state->misses + 1;
        turn_camera(checks * state->turn[0], checks * state->turn[1], checks * state->turn[2], state->pose);
    }
    for (int i = 0; i < 12; ++i)
        state->start[i] = state->pose[i];
}

// Both at once: the model was seen from where the frame started.
kernel void begin_tracking(float4 camera, int most_extrapolated, global State *state)
{
    keep_view(camera, state);
    begin_at_view(most_extrapolated, state);
}

// Begins the frame's second attempt where the first was refused; together they are one check. It starts from the kept pose
// and, after `search_after` failed checks, from there turned by `search_angle` (rad) about eight axes of the image in turn.
kernel void begin_retry(int search_after, float search_angle, global State *state)
{
    state->retrying = state->refusal != 0;
    if (!state->retrying)
        return;
    state->misses -= 1;
    if (state->misses < search_after)
        return;
    const float right = search_angle * cos(0.78539816f * state->misses);
    const float down = search_angle * sin(0.78539816f * state->misses);
    turn_camera(right * state->pose[0] + down * state->pose[1], right * state->pose[4] + down * state->pose[5],
                right * state->pose[8] + down * state->pose[9], state->pose);
}

// Whether a pose's position lies in the volume, a cube of `size` metres whose corner is the origin.
INLINE int in_volume(global const float *restrict pose, float size)
{
    return pose[3] >= 0.0f && pose[3] <= size && pose[7] >= 0.0f && pose[7] <= size && pose[11] >= 0.0f &&
           pose[11] <= size;
}

// Keeps the new pose when the residual is small, enough of the level solved last took part, and the camera can have moved
// so; otherwise goes back to where the frame started. `refusal` names the rule that refused it, 0 where none did.
// `max_translation` (m) and `max_rotation` (rad) are for one check, and grow with the checks missed. A motion beyond
// `near_motion` (m + rad) needs the share `far_inliers` and the part `kept_inliers` of the share at the last check that
// passed. For `recovery` checks after a refusal the view may be another one: instead of that part, the pixels that see the
// model must agree with it by `kept_agreement` of what they did then, and the share is asked of the second attempt only,
// which no prior guides. The camera may not leave the volume. Written so that NaN fails.
kernel void check_pose(int pixels, float max_residual, float min_inliers, float near_motion, float far_inliers,
                       float kept_inliers, float kept_agreement, float max_translation, float max_rotation,
                       float volume_size, int recovery, int conditional, global State *state)
{
    if (!wanted(conditional, state))
        return;
    const float x = state->pose[3] - state->previous[3], y = state->pose[7] - state->previous[7];
    const float z = state->pose[11] - state->previous[11];
    const float translation = sqrt(x * x + y * y + z * z);
    float turn[3];
    const float rotation = rotation_between(state->previous, state->pose, turn);
    const float checks = state->misses + 1, inliers = state->inliers / pixels;
    const float agreement = state->inliers / larger(state->overlap, 1.0f);
    const int agrees = agreement >= kept_agreement * state->last_agreement;
    const int enough = state->recovering ? agrees && (!state->retrying || inliers >= far_inliers)
                                         : inliers >= larger(far_inliers, kept_inliers * state->last_inliers);
    int refusal = 0;
    if (!(inliers >= min_inliers))
        refusal = REFUSED_INLIERS;
    else if (!(sqrt(state->squared_error / state->inliers) <= max_residual))
        refusal = REFUSED_RESIDUAL;
    else if (!(translation <= max_translation * checks))
        refusal = REFUSED_TRANSLATION;
    else if (!(rotation <= max_rotation * checks))
        refusal = REFUSED_ROTATION;
    else if (translation + rotation > near_motion && !enough)
        refusal = REFUSED_FAR_MOTION;
    else if (!in_volume(state->pose, volume_size) && in_volume(state->previous, volume_size))
        refusal = REFUSED_OUTSIDE;
    state->refusal = refusal;
    state->tracked = !refusal;
    state->translation = translation;
    state->rotation = rotation;
    if (refusal) {
        state->misses += 1;
        state->recovering = recovery;
        for (int i = 0; i < 12; ++i)
            state->pose[i] = state->previous[i];
        return;
    }
    for (int i = 0; i < 3; ++i)
        state->turn[i] = turn[i] / checks;
    state->last_inliers = inliers;
    state->last_agreement = agreement;
    state->misses = 0;
    state->recovering -= state->recovering > 0;
}
