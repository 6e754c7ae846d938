// Every `ratio`-th pixel, in metres; depth outside `nearest` to `farthest` millimetres becomes 0. A word holds the
// depth of two pixels, the first one in its low half.

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn millimetres_to_metres(@builtin(global_invocation_id) id: vec3u) {
    let x = i32(id.x);
    let y = i32(id.y);
    if (x >= parameters.width || y >= parameters.height) {
        return;
    }
    let source = u32((y * parameters.sensor_width + x) * parameters.ratio);
    let depth = i32((millimetres[source / 2u] >> (16u * (source % 2u))) & 0xffffu);
    let valid = depth >= parameters.nearest && depth <= parameters.farthest;
    metres[y * parameters.width + x] = select(0.0, f32(depth) * 0.001, valid);
}
