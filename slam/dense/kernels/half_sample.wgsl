// Half the size: the mean of those of a 2x2 block that lie within `range` of its first pixel.

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn half_sample(@builtin(global_invocation_id) id: vec3u) {
    let x = i32(id.x);
    let y = i32(id.y);
    if (x >= parameters.width || y >= parameters.height) {
        return;
    }
    let corner = 2 * y * parameters.fine_width + 2 * x;
    let below = corner + parameters.fine_width;
    let centre = fine[corner];
    let others = vec3f(fine[corner + 1], fine[below], fine[below + 1]);
    let used = select(vec3f(0.0), vec3f(1.0), abs(others - centre) < vec3f(parameters.range));
    let count = 1.0 + used.x + used.y + used.z;
    coarse[y * parameters.width + x] = (centre + dot(used, others)) / count;
}
