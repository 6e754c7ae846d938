// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5).
#include "arithmetic.h"
#include "state.h"

#ifdef DOUBLE_PRECISION
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
#else
typedef float real;
#endif

#define TRACK_GROUP 64 // work-items of a group, in the shape for GPUs

// 21 of J^T J (upper triangle), 6 of J^T e, the sum of e^2, the number of inliers; 3 stay free.
#define SUMS 32

// One pixel's row of the least-squares problem: the gradient of its error by the twist, and the error; all
// zero, with weight 0, where it has no partner.
typedef struct {
    float j0, j1, j2, j3, j4, j5, error, weight;
} Equation;

// Associates a pixel with the model by projection. Free of branches: what is rejected counts with weight 0,
// and an index is only trusted after its bounds test, which NaN fails.
INLINE Equation associate(float x, float y, float z, float nx, float ny, float nz, global const float *restrict model_x,
                          global const float *restrict model_y, global const float *restrict model_z,
                          global const float *restrict model_normal_x, global const float *restrict model_normal_y,
                          global const float *restrict model_normal_z, int model_width, int model_height,
                          float max_distance, float min_dot, const float *pose, const float *view)
{
    const float wx = pose[0] * x + pose[1] * y + pose[2] * z + pose[3];
    const float wy = pose[4] * x + pose[5] * y + pose[6] * z + pose[7];
    const float wz = pose[8] * x + pose[9] * y + pose[10] * z + pose[11];

    const float depth = view[8] * wx + view[9] * wy + view[10] * wz + view[11];
    const float inverse = 1.0f / depth;
    const float u = (view[0] * wx + view[1] * wy + view[2] * wz + view[3]) * inverse + 0.5f;
    const float v = (view[4] * wx + view[5] * wy + view[6] * wz + view[7]) * inverse + 0.5f;
    const float right = model_width - 1, bottom = model_height - 1;
    const int visible = (nx * nx + ny * ny + nz * nz > 0.0f) & (depth > 0.0f) & (u >= 0.0f) & (u <= right) &
                        (v >= 0.0f) & (v <= bottom);
    const int column = (int)(visible ? u : 0.0f), line = (int)(visible ? v : 0.0f);
    const int m = line * model_width + column;

    const float mx = model_normal_x[m], my = model_normal_y[m], mz = model_normal_z[m];
    const float dx = model_x[m] - wx, dy = model_y[m] - wy, dz = model_z[m] - wz;
    const float rx = pose[0] * nx + pose[1] * ny + pose[2] * nz;
    const float ry = pose[4] * nx + pose[5] * ny + pose[6] * nz;
    const float rz = pose[8] * nx + pose[9] * ny + pose[10] * nz;
    const int inlier = visible & (mx * mx + my * my + mz * mz > 0.0f) &
                       (dx * dx + dy * dy + dz * dz <= max_distance * max_distance) &
                       (rx * mx + ry * my + rz * mz >= min_dot);
    const float w = inlier ? 1.0f : 0.0f;

    Equation equation;
    equation.j0 = w * mx;
    equation.j1 = w * my;
    equation.j2 = w * mz;
    equation.j3 = w * (wy * mz - wz * my);
    equation.j4 = w * (wz * mx - wx * mz);
    equation.j5 = w * (wx * my - wy * mx);
    equation.error = w * (mx * dx + my * dy + mz * dz);
    equation.weight = w;
    return equation;
}

// Adds an equation to 29 separate sums, so that each can live in a vector register.
#define ACCUMULATE(q)                                                                                                  \
    s0 += q.j0 * q.j0, s1 += q.j0 * q.j1, s2 += q.j0 * q.j2, s3 += q.j0 * q.j3, s4 += q.j0 * q.j4, s5 += q.j0 * q.j5; \
    s6 += q.j1 * q.j1, s7 += q.j1 * q.j2, s8 += q.j1 * q.j3, s9 += q.j1 * q.j4, s10 += q.j1 * q.j5;                   \
    s11 += q.j2 * q.j2, s12 += q.j2 * q.j3, s13 += q.j2 * q.j4, s14 += q.j2 * q.j5;                                   \
    s15 += q.j3 * q.j3, s16 += q.j3 * q.j4, s17 += q.j3 * q.j5;                                                       \
    s18 += q.j4 * q.j4, s19 += q.j4 * q.j5;                                                                           \
    s20 += q.j5 * q.j5;                                                                                                \
    s21 += q.j0 * q.error, s22 += q.j1 * q.error, s23 += q.j2 * q.error;                                              \
    s24 += q.j3 * q.error, s25 += q.j4 * q.error, s26 += q.j5 * q.error;                                              \
    s27 += q.error * q.error, s28 += q.weight;

#define COLLECT(sums)                                                                                                  \
    sums[0] = s0, sums[1] = s1, sums[2] = s2, sums[3] = s3, sums[4] = s4, sums[5] = s5, sums[6] = s6, sums[7] = s7;   \
    sums[8] = s8, sums[9] = s9, sums[10] = s10, sums[11] = s11, sums[12] = s12, sums[13] = s13, sums[14] = s14;       \
    sums[15] = s15, sums[16] = s16, sums[17] = s17, sums[18] = s18, sums[19] = s19, sums[20] = s20, sums[21] = s21;   \
    sums[22] = s22, sums[23] = s23, sums[24] = s24, sums[25] = s25, sums[26] = s26, sums[27] = s27, sums[28] = s28;

// The parts of the normal equations of an image, one record of SUMS floats per work-group.
// Rows: a work-group is one work-item and sums a row. Pixels: the work-items of a group take pixels in turn and
// add up their sums in local memory, always in the same order.
#ifdef PIXELS
__attribute__((reqd_work_group_size(TRACK_GROUP, 1, 1)))
#endif
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
    float s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0, s6 = 0, s7 = 0, s8 = 0, s9 = 0, s10 = 0, s11 = 0, s12 = 0,
          s13 = 0, s14 = 0, s15 = 0, s16 = 0, s17 = 0, s18 = 0, s19 = 0, s20 = 0, s21 = 0, s22 = 0, s23 = 0, s24 = 0,
          s25 = 0, s26 = 0, s27 = 0, s28 = 0;

#ifdef PIXELS
    for (int i = get_global_id(0); i < width * height; i += get_global_size(0)) {
        const int y = i / width, x = i - y * width;
#else
    const int y = get_global_id(0);
    for (int x = 0; x < width; ++x) {
        const int i = y * width + x;
#endif
        const float z = depth[i];
        const Equation equation = associate((x - camera.z) * inverse_fx * z, (y - camera.w) * inverse_fy * z, z,
                                            normal_x[i], normal_y[i], normal_z[i], model_x, model_y, model_z,
                                            model_normal_x, model_normal_y, model_normal_z, model_width, model_height,
                                            max_distance, min_dot, pose, view);
        ACCUMULATE(equation)
    }

    global float *restrict record = records + get_group_id(0) * SUMS;
#ifdef PIXELS
    float sums[SUMS];
    COLLECT(sums)
    local float lane[TRACK_GROUP];
    const int me = get_local_id(0);
    for (int k = 0; k < 29; ++k) {
        lane[me] = sums[k];
        for (int stride = TRACK_GROUP / 2; stride > 0; stride /= 2) {
            barrier(CLK_LOCAL_MEM_FENCE);
            if (me < stride)
                lane[me] += lane[me + stride];
        }
        if (me == 0)
            record[k] = lane[0];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
#else
    COLLECT(record)
#endif
}

// Eigenvectors (columns of v) and eigenvalues (diagonal of a) of a symmetric matrix, by cyclic Jacobi rotations.
inline void diagonalise(real a[6][6], real v[6][6])
{
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j)
            v[i][j] = i == j;
    for (int sweep = 0; sweep < 12; ++sweep) {
        real off = 0, on = 0;
        for (int i = 0; i < 6; ++i) {
            on += a[i][i] * a[i][i];
            for (int j = i + 1; j < 6; ++j)
                off += a[i][j] * a[i][j];
        }
        if (!(off > on * (real)1e-26))
            return;
        for (int p = 0; p < 5; ++p)
            for (int q = p + 1; q < 6; ++q) {
                if (a[p][q] == 0)
                    continue;
                const real theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                const real t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const real c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 6; ++k) {
                    const real kp = a[k][p], kq = a[k][q];
                    a[k][p] = c * kp - s * kq;
                    a[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 6; ++k) {
                    const real pk = a[p][k], qk = a[q][k];
                    a[p][k] = c * pk - s * qk;
                    a[q][k] = s * pk + c * qk;
                    const real vp = v[k][p], vq = v[k][q];
                    v[k][p] = c * vp - s * vq;
                    v[k][q] = s * vp + c * vq;
                }
            }
    }
}

// Sums the records in their order, solves J^T J x = J^T e and moves the pose by exp(x). Directions whose
// eigenvalue is a millionth of the largest or less are left alone, as by a truncated SVD.
kernel void solve(global const float *restrict records, int count, float threshold, int iteration,
                  global State *restrict state)
{
    if (iteration > 0 && state->converged)
        return;
    real total[SUMS];
    for (int k = 0; k < SUMS; ++k)
        total[k] = 0;
    for (int record = 0; record < count; ++record)
        for (int k = 0; k < 29; ++k)
            total[k] += records[record * SUMS + k];

    real a[6][6], v[6][6];
    int k = 0;
    for (int i = 0; i < 6; ++i)
        for (int j = i; j < 6; ++j)
            a[i][j] = a[j][i] = total[k++];
    diagonalise(a, v);
    real largest = 0;
    for (int i = 0; i < 6; ++i)
        largest = a[i][i] > largest ? a[i][i] : largest;
    real x[6] = {0, 0, 0, 0, 0, 0};
    for (int i = 0; i < 6; ++i) {
        if (!(a[i][i] * (real)1e6 > largest))
            continue;
        real projection = 0;
        for (int j = 0; j < 6; ++j)
            projection += v[j][i] * total[21 + j];
        for (int j = 0; j < 6; ++j)
            x[j] += v[j][i] * projection / a[i][i];
    }

    // The exponential map of SE(3): Rodrigues' rotation R and the matrix V of the translation.
    const real wx = x[3], wy = x[4], wz = x[5];
    const real square = wx * wx + wy * wy + wz * wz, angle = sqrt(square);
    real sine = 1 - square / 6, cosine = (real)0.5 - square / 24, third = (real)1 / 6 - square / 120;
    if (angle > (real)1e-2) {
        sine = sin(angle) / angle;
        cosine = (1 - cos(angle)) / square;
        third = (1 - sine) / square;
    }
    const real skew[3][3] = {{0, -wz, wy}, {wz, 0, -wx}, {-wy, wx, 0}};
    real rotation[3][3], translation[3];
    for (int i = 0; i < 3; ++i) {
        translation[i] = 0;
        for (int j = 0; j < 3; ++j) {
            const real outer = x[3 + i] * x[3 + j] - (i == j ? square : 0);
            rotation[i][j] = (i == j) + sine * skew[i][j] + cosine * outer;
            translation[i] += ((i == j) + cosine * skew[i][j] + third * outer) * x[j];
        }
    }
    real moved[3][4];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j) {
            moved[i][j] = j == 3 ? translation[i] : 0;
            for (int l = 0; l < 3; ++l)
                moved[i][j] += rotation[i][l] * state->pose[4 * l + j];
        }

    // Thousands of float products would let the rotation drift: make its columns orthonormal again.
    for (int column = 0; column < 3; ++column) {
        for (int earlier = 0; earlier < column; ++earlier) {
            const real dot = moved[0][column] * moved[0][earlier] + moved[1][column] * moved[1][earlier] +
                             moved[2][column] * moved[2][earlier];
            for (int i = 0; i < 3; ++i)
                moved[i][column] -= dot * moved[i][earlier];
        }
        const real length = sqrt(moved[0][column] * moved[0][column] + moved[1][column] * moved[1][column] +
                                 moved[2][column] * moved[2][column]);
        for (int i = 0; i < 3; ++i)
            moved[i][column] /= length;
    }
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j)
            state->pose[4 * i + j] = moved[i][j];

    real norm = 0;
    for (int j = 0; j < 6; ++j)
        norm += x[j] * x[j];
    state->converged = sqrt(norm) < threshold;
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
