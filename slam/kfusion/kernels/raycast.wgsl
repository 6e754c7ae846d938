// The model that tracking sees: surface points and normals along the rays of a camera (Newcombe et al. 2011, section
// 3.4).
// A ray's parameter is its depth along the optical axis. It advances by `large_step` until the distance falls below
// `near_surface`, from then on by `small_step`, to the first negative value; the crossing is interpolated. Blocks far from
// every surface are jumped by whole steps, so that the points that matter are the same as without jumping. A ray that
// starts inside or behind a surface, or finds none, yields a zero vertex and a zero normal. Lengths are voxels, with 0 at
// the centre of the first; rays keep between the outermost centres.
#include "poses.wgsl"

// Exact where both ends are equal, which mix() does not promise.
fn between(a: f32, b: f32, fraction: f32) -> f32 {
    return a + (b - a) * fraction;
}

// Between the distances of a voxel and its neighbour in x, both as SCALE minus the distance.
fn along_line(i: i32, fraction: f32) -> f32 {
    return between(f32(voxels[i] & 0xffffu), f32(voxels[i + 1] & 0xffffu), fraction);
}

// Trilinear interpolation at a place in voxels, 0 at the centre of the first and resolution - 1 at that of the last;
// slightly beyond them the outermost cell is extrapolated.
fn interpolate(place: vec3f) -> f32 {
    let resolution = parameters.resolution;
    let cell = clamp(vec3i(place), vec3i(0), vec3i(resolution - 2));
    let fraction = place - vec3f(cell);
    let corner = (cell.z * resolution + cell.y) * resolution + cell.x;
    let far_corner = corner + resolution * resolution;
    let a = along_line(corner, fraction.x);
    let b = along_line(corner + resolution, fraction.x);
    let c = along_line(far_corner, fraction.x);
    let d = along_line(far_corner + resolution, fraction.x);
    return SCALE - between(between(a, b, fraction.y), between(c, d, fraction.y), fraction.z);
}

// The gradient of the distance. Away from the volume's sides this equals interpolating the central differences of the
// voxels.
fn gradient(place: vec3f) -> vec3f {
    return vec3f(
        interpolate(place + vec3f(1.0, 0.0, 0.0)) - interpolate(place - vec3f(1.0, 0.0, 0.0)),
        interpolate(place + vec3f(0.0, 1.0, 0.0)) - interpolate(place - vec3f(0.0, 1.0, 0.0)),
        interpolate(place + vec3f(0.0, 0.0, 1.0)) - interpolate(place - vec3f(0.0, 0.0, 1.0)),
    );
}

fn write_planes(i: i32, vertex: vec3f, normal: vec3f) {
    let plane = parameters.width * parameters.height;
    vertices[i] = vertex.x;
    vertices[plane + i] = vertex.y;
    vertices[2 * plane + i] = vertex.z;
    normals[i] = normal.x;
    normals[plane + i] = normal.y;
    normals[2 * plane + i] = normal.z;
}

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn raycast(@builtin(global_invocation_id) id: vec3u) {
    let column = i32(id.x);
    let row = i32(id.y);
    if (column >= parameters.width || row >= parameters.height) {
        return;
    }
    let camera = parameters.camera;
    let blocks = parameters.blocks;
    let pose = pose_of(state.pose);
    let per_voxel = 1.0 / parameters.voxel_size;
    let origin = pose[3] * per_voxel - 0.5;
    let ray = vec3f((f32(column) - camera.z) / camera.x, (f32(row) - camera.w) / camera.y, 1.0);
    let along = rotate(pose, ray) * per_voxel;
    let direction = select(vec3f(1e-9), along, abs(along) > vec3f(1e-9)); // it can be divided by
    let inverse = 1.0 / direction;

    // Where the ray enters and leaves the volume.
    let at_first = -origin * inverse;
    let at_last = (f32(parameters.resolution - 1) - origin) * inverse;
    let entries = min(at_first, at_last);
    let exits = max(at_first, at_last);
    var t = max(max(max(parameters.near_plane, entries.x), entries.y), entries.z);
    let end = min(min(min(parameters.far_plane, exits.x), exits.y), exits.z);

    var step_length = parameters.large_step;
    var value = 0.0;
    var first = true;
    while (t < end) {
        let place = origin + t * direction;
        let block = clamp(vec3i(place * (1.0 / f32(BLOCK))), vec3i(0), vec3i(blocks - 1));
        if (searched[(block.z * blocks + block.y) * blocks + block.x] == 0) {
            let side = vec3f(select(block, block + 1, direction > vec3f(0.0)) * BLOCK);
            let out = (side - place) * inverse;
            let length = clamp(min(min(out.x, out.y), out.z), 0.0, parameters.far_plane);
            t += f32(i32(length / step_length) + 1) * step_length;
        } else {
            value = interpolate(place);
            if (value < 0.0 || (first && value == 0.0)) {
                break;
            }
            step_length = select(step_length, parameters.small_step, value < parameters.near_surface);
            t += step_length;
        }
        first = false;
    }

    let i = row * parameters.width + column;
    if (first || !(t < end)) {
        write_planes(i, vec3f(0.0), vec3f(0.0));
        return;
    }
    let earlier = interpolate(origin + (t - step_length) * direction);
    if (!(earlier > value)) {
        write_planes(i, vec3f(0.0), vec3f(0.0));
        return;
    }
    t += step_length * value / (earlier - value);
    let place = origin + t * direction;
    let normal = gradient(place);
    let square = dot(normal, normal);
    if (!(square > 0.0)) {
        write_planes(i, vec3f(0.0), vec3f(0.0));
        return;
    }
    write_planes(i, (place + 0.5) * parameters.voxel_size, normal * inverseSqrt(square));
}
