// Unit normals towards the camera from central differences of the vertex map; zero where one of the five pixels has no
// depth. `camera` is (fx, fy, cx, cy); a mirrored camera has fy < 0.

// The point that pixel (x, y) sees at depth z, in the camera's frame.
fn vertex(x: i32, y: i32, z: f32) -> vec3f {
    let camera = parameters.camera;
    return vec3f((f32(x) - camera.z) / camera.x * z, (f32(y) - camera.w) / camera.y * z, z);
}

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn normal_map(@builtin(global_invocation_id) id: vec3u) {
    let x = i32(id.x);
    let y = i32(id.y);
    let width = parameters.width;
    let height = parameters.height;
    if (x >= width || y >= height) {
        return;
    }
    let above = max(y - 1, 0);
    let below = min(y + 1, height - 1);
    let left = max(x - 1, 0);
    let right = min(x + 1, width - 1);
    let place = y * width + x;
    let l = depth[y * width + left];
    let r = depth[y * width + right];
    let u = depth[above * width + x];
    let d = depth[below * width + x];
    let measured = depth[place] > 0.0 && l > 0.0 && r > 0.0 && u > 0.0 && d > 0.0;
    let side = select(-1.0, 1.0, parameters.camera.x * parameters.camera.y > 0.0);
    let across = vertex(right, y, r) - vertex(left, y, l);
    let down = vertex(x, below, d) - vertex(x, above, u);
    let direction = side * cross(down, across);
    let square = dot(direction, direction);
    let valid = measured && square > 0.0;
    let normal = direction * select(0.0, inverseSqrt(select(1.0, square, valid)), valid);
    let plane = width * height;
    normals[place] = normal.x;
    normals[plane + place] = normal.y;
    normals[2 * plane + place] = normal.z;
}
