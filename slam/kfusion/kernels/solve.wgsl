// Sums the records, solves for the twist and moves the pose by it. One workgroup, of which each invocation sums one float
// of its share of the records. `prior`: see add_prior; it guides a camera that recovers.
#include "conditions.wgsl"
#include "turning.wgsl"

var<workgroup> wanted: i32;
var<workgroup> lanes: array<f32, SOLVERS>;

// Adds to the normal equations that the camera stays where ICP started: a metre or a radian away costs as much as an error
// of sqrt(`prior`) m of every inlier. It decides where the image does not, as along a flat wall, and fades with the checks
// missed.
fn add_prior(total: ptr<function, array<f32, SUMS>>) {
    let checks = f32(state.misses + 1);
    let weight = parameters.prior * (*total)[28] / (checks * checks);
    let pose = pose_of(state.pose);
    let start = pose_of(state.start);
    let moved = pose[3] - start[3];
    let turn = rotation_between(start, pose).vector;
    let away = Vector6(moved.x, moved.y, moved.z, turn.x, turn.y, turn.z);
    // The twist (v, w) about the volume's corner moves the camera by v + w x position.
    var rows: Matrix6;
    for (var i = 0; i < 6; i++) {
        rows[7 * i] = 1.0;
    }
    rows[4] = pose[3].z;
    rows[5] = -pose[3].y;
    rows[9] = -pose[3].z;
    rows[11] = pose[3].x;
    rows[15] = pose[3].y;
    rows[16] = -pose[3].x;
    for (var row = 0; row < 6; row++) {
        var k = 0;
        for (var i = 0; i < 6; i++) {
            (*total)[21 + i] -= weight * rows[6 * row + i] * away[row];
            for (var j = i; j < 6; j++) {
                (*total)[k] += weight * rows[6 * row + i] * rows[6 * row + j];
                k++;
            }
        }
    }
}

@compute @workgroup_size(SOLVERS)
fn solve(@builtin(local_invocation_index) lane: u32) {
    // What all invocations read here together is uniform, thus barriers may follow.
    if (lane == 0u) {
        wanted = select(0, 1, is_wanted());
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
    state.squared_error = total[27];
    state.inliers = total[28];
    state.overlap = total[29];
    for (var k = 0; k < 21; k++) {
        state.normal_matrix[k] = total[k];
    }
    if (state.recovering != 0 && state.retrying == 0) {
        add_prior(&total);
    }
    let twist = solve_symmetric(&total);
    state.pose = rows_of(moved_by(twist, pose_of(state.pose)));
    state.iterating = select(1, 0, norm_of(twist) < parameters.threshold);
}
