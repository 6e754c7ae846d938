// From normal equations to a moved pose, by one work-item. Include least_squares.h before.

#ifdef DOUBLE_PRECISION
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
#else
typedef float real;
#endif

// Eigenvectors (columns of v) and eigenvalues (diagonal of a) of a symmetric matrix, by cyclic Jacobi rotations.
static inline void diagonalise(real a[6][6], real v[6][6])
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

// Sums the records of an image in their order.
static inline void sum_records(global const float *restrict records, int count, real total[SUMS])
{
    for (int k = 0; k < SUMS; ++k)
        total[k] = 0;
    for (int record = 0; record < count; ++record)
        for (int k = 0; k < SUMS - 1; ++k)
            total[k] += records[record * SUMS + k];
}

// Solves a x = b by LDL^T and returns 1, where no eigenvalue of `a` can be a millionth of the largest or less: these lie
// between 1 / trace(1 / a) and trace(a). Returns 0 otherwise.
static inline int solve_strong(const real a[6][6], const real b[6], real x[6])
{
    real lower[6][6], pivot[6], trace = 0, inverse_trace = 0;
    for (int j = 0; j < 6; ++j) {
        pivot[j] = a[j][j];
        for (int k = 0; k < j; ++k)
            pivot[j] -= lower[j][k] * lower[j][k] * pivot[k];
        if (!(pivot[j] > 0))
            return 0;
        for (int i = j + 1; i < 6; ++i) {
            real value = a[i][j];
            for (int k = 0; k < j; ++k)
                value -= lower[i][k] * lower[j][k] * pivot[k];
            lower[i][j] = value / pivot[j];
        }
        trace += a[j][j];
    }
    for (int column = 0; column < 6; ++column) {
        real inverse[6];
        for (int i = column; i < 6; ++i) {
            inverse[i] = i == column;
            for (int k = column; k < i; ++k)
                inverse[i] -= lower[i][k] * inverse[k];
            inverse_trace += inverse[i] * inverse[i] / pivot[i];
        }
    }
    if (!(trace * inverse_trace < (real)1e6))
        return 0;
    for (int i = 0; i < 6; ++i) {
        x[i] = b[i];
        for (int k = 0; k < i; ++k)
            x[i] -= lower[i][k] * x[k];
    }
    for (int i = 5; i >= 0; --i) {
        x[i] /= pivot[i];
        for (int k = i + 1; k < 6; ++k)
            x[i] -= lower[k][i] * x[k];
    }
    return 1;
}

// The twist x of J^T J x = J^T e, from the summed records. Directions whose eigenvalue is a millionth of the
// largest or less are left alone, as by a truncated SVD.
static inline void solve_symmetric(const real total[SUMS], real x[6])
{
    real a[6][6], v[6][6];
    int k = 0;
    for (int i = 0; i < 6; ++i)
        for (int j = i; j < 6; ++j)
            a[i][j] = a[j][i] = total[k++];
    if (solve_strong(a, total + 21, x))
        return;
    diagonalise(a, v);
    real largest = 0;
    for (int i = 0; i < 6; ++i) {
        largest = a[i][i] > largest ? a[i][i] : largest;
        x[i] = 0;
    }
    for (int i = 0; i < 6; ++i) {
        if (!(a[i][i] * (real)1e6 > largest))
            continue;
        real projection = 0;
        for (int j = 0; j < 6; ++j)
            projection += v[j][i] * total[21 + j];
        for (int j = 0; j < 6; ++j)
            x[j] += v[j][i] * projection / a[i][i];
    }
}

static inline real norm_of(const real x[6])
{
    real square = 0;
    for (int j = 0; j < 6; ++j)
        square += x[j] * x[j];
    return sqrt(square);
}

// The exponential map of SE(3): Rodrigues' rotation R and the matrix V of the translation.
static inline void exponential(const real x[6], real motion[3][4])
{
    const real wx = x[3], wy = x[4], wz = x[5];
    const real square = wx * wx + wy * wy + wz * wz, angle = sqrt(square);
    real sine = 1 - square / 6, cosine = (real)0.5 - square / 24, third = (real)1 / 6 - square / 120;
    if (angle > (real)1e-2) {
        sine = sin(angle) / angle;
        cosine = (1 - cos(angle)) / square;
        third = (1 - sine) / square;
    }
    const real skew[3][3] = {{0, -wz, wy}, {wz, 0, -wx}, {-wy, wx, 0}};
    for (int i = 0; i < 3; ++i) {
        motion[i][3] = 0;
        for (int j = 0; j < 3; ++j) {
            const real outer = x[3 + i] * x[3 + j] - (i == j ? square : 0);
            motion[i][j] = (i == j) + sine * skew[i][j] + cosine * outer;
            motion[i][3] += ((i == j) + cosine * skew[i][j] + third * outer) * x[j];
        }
    }
}

// Thousands of float products would let a rotation drift: makes its columns orthonormal again.
static inline void orthonormalise(real pose[3][4])
{
    for (int column = 0; column < 3; ++column) {
        for (int earlier = 0; earlier < column; ++earlier) {
            const real dot = pose[0][column] * pose[0][earlier] + pose[1][column] * pose[1][earlier] +
                             pose[2][column] * pose[2][earlier];
            for (int i = 0; i < 3; ++i)
                pose[i][column] -= dot * pose[i][earlier];
        }
        const real length = sqrt(pose[0][column] * pose[0][column] + pose[1][column] * pose[1][column] +
                                 pose[2][column] * pose[2][column]);
        for (int i = 0; i < 3; ++i)
            pose[i][column] /= length;
    }
}

// Moves a pose by exp(x), from the left.
static inline void move_pose(const real x[6], global float *pose)
{
    real motion[3][4], result[3][4];
    exponential(x, motion);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j) {
            result[i][j] = j == 3 ? motion[i][3] : 0;
            for (int l = 0; l < 3; ++l)
                result[i][j] += motion[i][l] * pose[4 * l + j];
        }
    orthonormalise(result);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j)
            pose[4 * i + j] = result[i][j];
}
