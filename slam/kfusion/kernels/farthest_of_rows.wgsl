// The largest depth of each row. One invocation per row.

@compute @workgroup_size(SUM_GROUP)
fn farthest_of_rows(@builtin(global_invocation_id) id: vec3u) {
    let y = i32(id.x);
    if (y >= parameters.height) {
        return;
    }
    var farthest = 0.0;
    for (var x = 0; x < parameters.width; x++) {
        farthest = max(farthest, metres[y * parameters.width + x]);
    }
    row_farthest[y] = farthest;
}
