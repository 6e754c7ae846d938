// Tomasi and Manduchi 1998, over 5x5 pixels. The factors are 1 / (2 sigma^2). A pixel without depth stays so and does not
// count for its neighbours. A neighbour outside the image is the nearest pixel inside.
const LOG2_E = 1.44269504f;

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn bilateral_filter(@builtin(global_invocation_id) id: vec3u) {
    let x = i32(id.x);
    let y = i32(id.y);
    if (x >= parameters.width || y >= parameters.height) {
        return;
    }
    let place = y * parameters.width + x;
    let centre = depth[place];
    if (!(centre > 0.0)) {
        filtered[place] = 0.0;
        return;
    }
    var sum = 0.0;
    var weights = 0.0;
    for (var dy = -2; dy <= 2; dy++) {
        let row = clamp(y + dy, 0, parameters.height - 1) * parameters.width;
        for (var dx = -2; dx <= 2; dx++) {
            let neighbour = depth[row + clamp(x + dx, 0, parameters.width - 1)];
            let difference = neighbour - centre;
            let away = f32(dx * dx + dy * dy) * parameters.spatial_factor;
            let exponent = difference * difference * parameters.range_factor + away;
            let weight = select(0.0, exp2(-LOG2_E * exponent), neighbour > 0.0);
            sum += weight * neighbour;
            weights += weight;
        }
    }
    filtered[place] = sum / weights; // the pixel itself has weight 1
}
