// From normal equations to a moved pose, by one invocation.
#include "poses.wgsl"

// A symmetric 6x6 matrix, row by row, and a twist: translation, then rotation vector.
alias Matrix6 = array<f32, 36>;
alias Vector6 = array<f32, 6>;

const SMALLEST_PART = 1e-6f; // of the largest eigenvalue: a direction below it is left alone
// Sum of squares off the diagonal, as a part of that on it: as small as 24 bits of a float allow.
const DIAGONAL = 1e-14f;

// Eigenvectors (columns of v) and eigenvalues (diagonal of a), by cyclic Jacobi rotations.
fn diagonalise(a: ptr<function, Matrix6>, v: ptr<function, Matrix6>) {
    for (var i = 0; i < 36; i++) {
        (*v)[i] = select(0.0, 1.0, i % 7 == 0);
    }
    for (var sweep = 0; sweep < 12; sweep++) {
        var off = 0.0;
        var on = 0.0;
        for (var i = 0; i < 6; i++) {
            on += (*a)[7 * i] * (*a)[7 * i];
            for (var j = i + 1; j < 6; j++) {
                off += (*a)[6 * i + j] * (*a)[6 * i + j];
            }
        }
        if (!(off > on * DIAGONAL)) {
            return;
        }
        for (var p = 0; p < 5; p++) {
            for (var q = p + 1; q < 6; q++) {
                eliminate(a, v, p, q);
            }
        }
    }
}

// Rotates rows and columns p and q so that a[p][q] becomes 0.
fn eliminate(a: ptr<function, Matrix6>, v: ptr<function, Matrix6>, p: i32, q: i32) {
    let corner = (*a)[6 * p + q];
    let difference = (*a)[7 * q] - (*a)[7 * p];
    if (abs(corner) <= 1e-9 * abs(difference)) {
        return; // the angle is below what a float can turn by, and the quotient might overflow
    }
    let theta = difference / (2.0 * corner);
    let t = select(1.0, -1.0, theta < 0.0) / (abs(theta) + sqrt(theta * theta + 1.0));
    let c = inverseSqrt(t * t + 1.0);
    let s = t * c;
    for (var k = 0; k < 6; k++) {
        let kp = (*a)[6 * k + p];
        let kq = (*a)[6 * k + q];
        (*a)[6 * k + p] = c * kp - s * kq;
        (*a)[6 * k + q] = s * kp + c * kq;
    }
    for (var k = 0; k < 6; k++) {
        let pk = (*a)[6 * p + k];
        let qk = (*a)[6 * q + k];
        (*a)[6 * p + k] = c * pk - s * qk;
        (*a)[6 * q + k] = s * pk + c * qk;
        let vp = (*v)[6 * k + p];
        let vq = (*v)[6 * k + q];
        (*v)[6 * k + p] = c * vp - s * vq;
        (*v)[6 * k + q] = s * vp + c * vq;
    }
}

// Solves a x = b by LDL^T and returns true, where no eigenvalue of `a` can be a millionth of the largest or less: these
// lie between 1 / trace(1 / a) and trace(a). Returns false otherwise.
fn solve_strong(a: ptr<function, Matrix6>, b: ptr<function, Vector6>, x: ptr<function, Vector6>) -> bool {
    var lower: Matrix6;
    var pivots: Vector6;
    var trace = 0.0;
    for (var j = 0; j < 6; j++) {
        var pivot = (*a)[7 * j];
        for (var k = 0; k < j; k++) {
            pivot -= lower[6 * j + k] * lower[6 * j + k] * pivots[k];
        }
        // A smaller pivot would fail the test of the traces too; it might overflow before.
        if (!(pivot > SMALLEST_PART * (*a)[7 * j])) {
            return false;
        }
        pivots[j] = pivot;
        for (var i = j + 1; i < 6; i++) {
            var value = (*a)[6 * i + j];
            for (var k = 0; k < j; k++) {
                value -= lower[6 * i + k] * lower[6 * j + k] * pivots[k];
            }
            lower[6 * i + j] = value / pivot;
        }
        trace += (*a)[7 * j];
    }
    var inverse_trace = 0.0;
    for (var column = 0; column < 6; column++) {
        var inverse: Vector6;
        for (var i = column; i < 6; i++) {
            var value = select(0.0, 1.0, i == column);
            for (var k = column; k < i; k++) {
                value -= lower[6 * i + k] * inverse[k];
            }
            inverse[i] = value;
            inverse_trace += value * value / pivots[i];
        }
    }
    if (!(trace * inverse_trace * SMALLEST_PART < 1.0)) {
        return false;
    }
    for (var i = 0; i < 6; i++) {
        var value = (*b)[i];
        for (var k = 0; k < i; k++) {
            value -= lower[6 * i + k] * (*x)[k];
        }
        (*x)[i] = value;
    }
    for (var i = 5; i >= 0; i--) {
        var value = (*x)[i] / pivots[i];
        for (var k = i + 1; k < 6; k++) {
            value -= lower[6 * k + i] * (*x)[k];
        }
        (*x)[i] = value;
    }
    return true;
}

// The twist x of J^T J x = J^T e, from a record of `normal_equations.wgsl`. Directions whose eigenvalue is a millionth
// of the largest or less are left alone, as by a truncated SVD.
fn solve_symmetric(record: ptr<function, array<f32, SUMS>>) -> Vector6 {
    var a: Matrix6;
    var b: Vector6;
    var k = 0;
    for (var i = 0; i < 6; i++) {
        b[i] = (*record)[21 + i];
        for (var j = i; j < 6; j++) {
            a[6 * i + j] = (*record)[k];
            a[6 * j + i] = (*record)[k];
            k++;
        }
    }
    var x: Vector6;
    if (solve_strong(&a, &b, &x)) {
        return x;
    }
    x = Vector6();
    var v: Matrix6;
    diagonalise(&a, &v);
    var largest = 0.0;
    for (var i = 0; i < 6; i++) {
        largest = max(largest, a[7 * i]);
    }
    for (var i = 0; i < 6; i++) {
        if (!(a[7 * i] > SMALLEST_PART * largest)) {
            continue;
        }
        var projection = 0.0;
        for (var j = 0; j < 6; j++) {
            projection += v[6 * j + i] * b[j];
        }
        for (var j = 0; j < 6; j++) {
            x[j] += v[6 * j + i] * projection / a[7 * i];
        }
    }
    return x;
}

fn norm_of(x: Vector6) -> f32 {
    let a = vec3f(x[0], x[1], x[2]);
    let b = vec3f(x[3], x[4], x[5]);
    return sqrt(dot(a, a) + dot(b, b));
}

// sin(w) / w, (1 - cos(w)) / w^2 and (w - sin(w)) / w^3 of w^2. WGSL promises 11 bits of sin() and cos(), thus a series up
// to 3 radians.
fn rotation_factors(square: f32) -> vec3f {
    if (square > 9.0) {
        let angle = sqrt(square);
        let sine = sin(angle) / angle;
        return vec3f(sine, (1.0 - cos(angle)) / square, (1.0 - sine) / square);
    }
    var factors = vec3f(0.0);
    for (var k = 8; k > 0; k--) {
        let n = f32(2 * k);
        factors = 1.0 - factors * square / (vec3f(n, n + 1.0, n + 2.0) * vec3f(n + 1.0, n + 2.0, n + 3.0));
    }
    return factors / vec3f(1.0, 2.0, 6.0);
}

// A pose moved by exp(x), from the left.
fn moved_by(x: Vector6, pose: mat4x3f) -> mat4x3f {
    let translation = vec3f(x[0], x[1], x[2]);
    let w = vec3f(x[3], x[4], x[5]);
    let square = dot(w, w);
    let factors = rotation_factors(square);
    let skew = mat3x3f(0.0, w.z, -w.y, -w.z, 0.0, w.x, w.y, -w.x, 0.0);
    let identity = mat3x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let squared = mat3x3f(w * w.x, w * w.y, w * w.z) - square * identity;
    let rotation = identity + factors.x * skew + factors.y * squared;
    let shift = (identity + factors.y * skew + factors.z * squared) * translation;
    return orthonormalised(mat4x3f(
        rotation * pose[0],
        rotation * pose[1],
        rotation * pose[2],
        rotation * pose[3] + shift,
    ));
}

// Thousands of float products would let a rotation drift: its columns become orthonormal again.
fn orthonormalised(pose: mat4x3f) -> mat4x3f {
    let x = normalize(pose[0]);
    let y = normalize(pose[1] - dot(pose[1], x) * x);
    let leaning = pose[2] - dot(pose[2], x) * x;
    return mat4x3f(x, y, normalize(leaning - dot(leaning, y) * y), pose[3]);
}
