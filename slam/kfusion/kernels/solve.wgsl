// Sums the records, solves for the twist and moves the pose by it. One workgroup, of which each invocation sums one float
// of its share of the records.
#include "solving.wgsl"

var<workgroup> wanted: i32;
var<workgroup> lanes: array<f32, SOLVERS>;

@compute @workgroup_size(SOLVERS)
fn solve(@builtin(local_invocation_index) lane: u32) {
    // What all invocations read here together is uniform, thus barriers may follow.
    if (lane == 0u) {
        wanted = select(1, state.iterating, parameters.conditional != 0);
    }
    if (workgroupUniformLoad(&wanted) == 0) {
        return;
    }
    var sum = 0.0;
    for (var record = i32(lane / SUMS); record < parameters.count; record += SOLVERS / SUMS) {
        sum += records[record * SUMS + i32(lane % SUMS)];
    }
    lanes[lane] = sum;
    workgroupBarrier();
    if (lane > 0u) {
        return;
    }
    var total: array<f32, SUMS>;
    for (var k = 0; k < SUMS; k++) {
        total[k] = 0.0;
        for (var other = k; other < SOLVERS; other += SUMS) {
            total[k] += lanes[other];
        }
    }
    let twist = solve_symmetric(&total);
    state.pose = rows_of(moved_by(twist, pose_of(state.pose)));
    state.iterating = select(1, 0, norm_of(twist) < parameters.threshold);
    state.squared_error = total[27];
    state.inliers = total[28];
    for (var k = 0; k < 21; k++) {
        state.normal_matrix[k] = total[k];
    }
}
