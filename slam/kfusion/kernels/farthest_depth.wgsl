// How far the volume can be seen in a frame: no voxel lies deeper than the largest depth of the image, which is the
// largest of its rows. One workgroup.

var<workgroup> lanes: array<f32, SUM_GROUP>;

@compute @workgroup_size(SUM_GROUP)
fn farthest_depth(@builtin(local_invocation_index) lane: u32) {
    var farthest = 0.0;
    for (var y = i32(lane); y < parameters.height; y += SUM_GROUP) {
        farthest = max(farthest, row_farthest[y]);
    }
    lanes[lane] = farthest;
    workgroupBarrier();
    if (lane == 0u) {
        for (var other = 1; other < SUM_GROUP; other++) {
            farthest = max(farthest, lanes[other]);
        }
        state.farthest = farthest;
    }
}
