// The normal equations of a motion's six unknowns, summed over an image.
// What a record holds: 21 of J^T J (upper triangle), 6 of J^T e, the sum of e^2, the number of inliers, that
// of pixels that see the model, and 2 zeros.

// One pixel's row of the least-squares problem: the gradient of its error by the translation and by the rotation vector,
// and the error; all zero, with weight 0, where it has no partner.
struct Equation {
    a: vec3f,
    b: vec3f,
    error: f32,
    weight: f32,
}

// The floats of a record, four by four.
struct Sums {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
    s4: vec4f,
    s5: vec4f,
    s6: vec4f,
    inliers: f32,
    overlap: f32,
}

fn accumulate(sums: ptr<function, Sums>, row: Equation) {
    let a = row.a;
    let b = row.b;
    let e = row.error;
    (*sums).s0 += vec4f(a.x * a, a.x * b.x);
    (*sums).s1 += vec4f(a.x * b.yz, a.y * a.yz);
    (*sums).s2 += vec4f(a.y * b, a.z * a.z);
    (*sums).s3 += vec4f(a.z * b, b.x * b.x);
    (*sums).s4 += vec4f(b.x * b.yz, b.y * b.yz);
    (*sums).s5 += vec4f(b.z * b.z, a * e);
    (*sums).s6 += vec4f(b * e, e * e);
    (*sums).inliers += row.weight;
}

// The sums of all invocations of a group, float after float.
var<workgroup> lanes: array<f32, SUMS * SUM_GROUP>;

fn store_lanes(first: u32, lane: u32, values: vec4f) {
    lanes[first * SUM_GROUP + lane] = values.x;
    lanes[(first + 1u) * SUM_GROUP + lane] = values.y;
    lanes[(first + 2u) * SUM_GROUP + lane] = values.z;
    lanes[(first + 3u) * SUM_GROUP + lane] = values.w;
}

// Float number `lane` of the group's record, for the first SUMS invocations: the sum over all invocations, always in
// the same order. Call it in uniform control flow.
fn sum_of_group(sums: Sums, lane: u32) -> f32 {
    store_lanes(0u, lane, sums.s0);
    store_lanes(4u, lane, sums.s1);
    store_lanes(8u, lane, sums.s2);
    store_lanes(12u, lane, sums.s3);
    store_lanes(16u, lane, sums.s4);
    store_lanes(20u, lane, sums.s5);
    store_lanes(24u, lane, sums.s6);
    store_lanes(28u, lane, vec4f(sums.inliers, sums.overlap, 0.0, 0.0));
    workgroupBarrier();
    var total = 0.0;
    if (lane < SUMS) {
        // Each invocation begins at another one's value: neighbours read from different banks of the memory.
        for (var k = 0u; k < SUM_GROUP; k++) {
            total += lanes[lane * SUM_GROUP + (k + lane) % SUM_GROUP];
        }
    }
    return total;
}
