// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5).
#include "state.h"

#ifdef DOUBLE_PRECISION
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
#else
typedef float real;
#endif

// 21 of J^T J (upper triangle), 6 of J^T e, the sum of e^2, the number of inliers; 3 stay free.
#define SUMS 32

// Associates each pixel of a row by projection and sums its part of the normal equations. Free of
// branches: what is rejected counts with weight 0, and an index is only trusted after its bounds test.
kernel void track(global const float *restrict depth, global const float *restrict normal_x,
                  global const float *restrict normal_y, global const float *restrict normal_z, int width,
                  float4 camera, global const float *restrict model_x, global const float *restrict model_y,
                  global const float *restrict model_z, global const float *restrict model_normal_x,
                  global const float *restrict model_normal_y, global const float *restrict model_normal_z,
                  int model_width, int model_height, float max_distance, float min_dot, int iteration,
                  global const State *restrict state, global float *restrict row_sums)
{
    if (iteration > 0 && state->converged)
        return;
    const int y = get_global_id(0);
    const float p0 = state->pose[0], p1 = state->pose[1], p2 = state->pose[2], p3 = state->pose[3];
    const float p4 = state->pose[4], p5 = state->pose[5], p6 = state->pose[6], p7 = state->pose[7];
    const float p8 = state->pose[8], p9 = state->pose[9], p10 = state->pose[10], p11 = state->pose[11];
    const float v0 = state->view[0], v1 = state->view[1], v2 = state->view[2], v3 = state->view[3];
    const float v4 = state->view[4], v5 = state->view[5], v6 = state->view[6], v7 = state->view[7];
    const float v8 = state->view[8], v9 = state->view[9], v10 = state->view[10], v11 = state->view[11];
    const float inverse_fx = 1.0f / camera.x, ray_y = (y - camera.w) / camera.y;
    const float right = model_width - 1, bottom = model_height - 1;
    const float max_square = max_distance * max_distance;
    float s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0, s6 = 0, s7 = 0, s8 = 0, s9 = 0, s10 = 0, s11 = 0, s12 = 0,
          s13 = 0, s14 = 0, s15 = 0, s16 = 0, s17 = 0, s18 = 0, s19 = 0, s20 = 0, s21 = 0, s22 = 0, s23 = 0, s24 = 0,
          s25 = 0, s26 = 0, s27 = 0, s28 = 0;

    for (int x = 0; x < width; ++x) {
        const int i = y * width + x;
        const float z = depth[i];
        const float cx = (x - camera.z) * inverse_fx * z, cy = ray_y * z;
        const float nx = normal_x[i], ny = normal_y[i], nz = normal_z[i];
        const float wx = p0 * cx + p1 * cy + p2 * z + p3;
        const float wy = p4 * cx + p5 * cy + p6 * z + p7;
        const float wz = p8 * cx + p9 * cy + p10 * z + p11;

        const float projected_z = v8 * wx + v9 * wy + v10 * wz + v11;
        const float inverse_z = 1.0f / projected_z;
        const float u = (v0 * wx + v1 * wy + v2 * wz + v3) * inverse_z + 0.5f;
        const float v = (v4 * wx + v5 * wy + v6 * wz + v7) * inverse_z + 0.5f;
        const int visible = (nx * nx + ny * ny + nz * nz > 0.0f) & (projected_z > 0.0f) & (u >= 0.0f) & (u <= right) &
                            (v >= 0.0f) & (v <= bottom);
        const int column = (int)(visible ? u : 0.0f), line = (int)(visible ? v : 0.0f);
        const int m = line * model_width + column;

        const float mx = model_normal_x[m], my = model_normal_y[m], mz = model_normal_z[m];
        const float dx = model_x[m] - wx, dy = model_y[m] - wy, dz = model_z[m] - wz;
        const float rx = p0 * nx + p1 * ny + p2 * nz;
        const float ry = p4 * nx + p5 * ny + p6 * nz;
        const float rz = p8 * nx + p9 * ny + p10 * nz;
        const int inlier = visible & (mx * mx + my * my + mz * mz > 0.0f) &
                           (dx * dx + dy * dy + dz * dz <= max_square) & (rx * mx + ry * my + rz * mz >= min_dot);
        const float w = inlier ? 1.0f : 0.0f;

        const float e = w * (mx * dx + my * dy + mz * dz);
        const float j0 = w * mx, j1 = w * my, j2 = w * mz;
        const float j3 = w * (wy * mz - wz * my), j4 = w * (wz * mx - wx * mz), j5 = w * (wx * my - wy * mx);
        s0 += j0 * j0; s1 += j0 * j1; s2 += j0 * j2; s3 += j0 * j3; s4 += j0 * j4; s5 += j0 * j5;
        s6 += j1 * j1; s7 += j1 * j2; s8 += j1 * j3; s9 += j1 * j4; s10 += j1 * j5;
        s11 += j2 * j2; s12 += j2 * j3; s13 += j2 * j4; s14 += j2 * j5;
        s15 += j3 * j3; s16 += j3 * j4; s17 += j3 * j5;
        s18 += j4 * j4; s19 += j4 * j5;
        s20 += j5 * j5;
        s21 += j0 * e; s22 += j1 * e; s23 += j2 * e; s24 += j3 * e; s25 += j4 * e; s26 += j5 * e;
        s27 += e * e;
        s28 += w;
    }

    global float *restrict sums = row_sums + y * SUMS;
    sums[0] = s0; sums[1] = s1; sums[2] = s2; sums[3] = s3; sums[4] = s4; sums[5] = s5; sums[6] = s6; sums[7] = s7;
    sums[8] = s8; sums[9] = s9; sums[10] = s10; sums[11] = s11; sums[12] = s12; sums[13] = s13; sums[14] = s14;
    sums[15] = s15; sums[16] = s16; sums[17] = s17; sums[18] = s18; sums[19] = s19; sums[20] = s20; sums[21] = s21;
    sums[22] = s22; sums[23] = s23; sums[24] = s24; sums[25] = s25; sums[26] = s26; sums[27] = s27; sums[28] = s28;
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

// Sums the rows in their order, solves J^T J x = J^T e and moves the pose by exp(x). Directions whose
// eigenvalue is a millionth of the largest or less are left alone, as by a truncated SVD.
kernel void solve(global const float *restrict row_sums, int rows, float threshold, int iteration,
                  global State *restrict state)
{
    if (iteration > 0 && state->converged)
        return;
    real total[SUMS];
    for (int k = 0; k < SUMS; ++k)
        total[k] = 0;
    for (int row = 0; row < rows; ++row)
        for (int k = 0; k < 29; ++k)
            total[k] += row_sums[row * SUMS + k];

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
