// The truncated signed distance function (Newcombe et al. 2011, section 3.3; Curless and Levoy 1996). Voxel (x, y, z) is
// centred at (x+.5, y+.5, z+.5). The low half of its word holds SCALE minus the distance, the high half the weight: a word
// of 0 is empty space, never observed.
// Fuses a depth image. Only voxels that the camera may see are visited, no deeper than the farthest depth plus mu. A block
// in which a voxel has come nearer to a surface than `near_surface` is marked for the raycast, for good. An invocation
// owns a column along z, so that neighbours in x read and write side by side.
#include "poses.wgsl"

// Narrows `range` to the whole numbers n with offset + slope n >= 0, one more at either end.
fn clip(range: vec2f, offset: f32, slope: f32) -> vec2f {
    if (slope > 0.0) {
        return vec2f(max(range.x, -offset / slope - 1.0), range.y);
    }
    if (slope < 0.0) {
        return vec2f(range.x, min(range.y, -offset / slope + 1.0));
    }
    return vec2f(range.x, select(range.y, -1.0, offset < 0.0));
}

// The first and the last step along a line of voxels that the camera may see, no deeper than `limit`; the last below the
// first where there is none. The line's first centre is at `base` in the camera's frame, a step adds `slope`.
fn visible_range(base: vec3f, slope: vec3f, limit: f32) -> vec2i {
    let camera = parameters.camera;
    let last = f32(parameters.resolution - 1);
    let left = camera.z + 0.5;
    let right = left - f32(parameters.width - 1);
    let top = camera.w + 0.5;
    let bottom = top - f32(parameters.height - 1);
    var range = clip(vec2f(0.0, last), base.z, slope.z);
    range = clip(range, limit - base.z, -slope.z);
    range = clip(range, camera.x * base.x + left * base.z, camera.x * slope.x + left * slope.z);
    range = clip(range, -camera.x * base.x - right * base.z, -camera.x * slope.x - right * slope.z);
    range = clip(range, camera.y * base.y + top * base.z, camera.y * slope.y + top * slope.z);
    range = clip(range, -camera.y * base.y - bottom * base.z, -camera.y * slope.y - bottom * slope.z);
    if (!(range.x <= range.y)) {
        return vec2i(0, -1);
    }
    return vec2i(max(i32(range.x), 0), clamp(i32(range.y), 0, parameters.resolution - 1));
}

// How far in front of the surface along its ray a voxel lies that is seen at `place` in the camera's frame; below -mu
// where nothing was measured.
fn measured_difference(place: vec3f) -> f32 {
    let unseen = -2.0 * parameters.mu;
    if (!(place.z > 0.0001)) {
        return unseen;
    }
    let ray = place.xy / place.z;
    let pixel = parameters.camera.xy * ray + parameters.camera.zw + 0.5;
    let right = f32(parameters.width - 1);
    let bottom = f32(parameters.height - 1);
    if (!(pixel.x >= 0.0 && pixel.x <= right && pixel.y >= 0.0 && pixel.y <= bottom)) {
        return unseen;
    }
    let measured = depth[i32(pixel.y) * parameters.width + i32(pixel.x)];
    return select(unseen, (measured - place.z) * sqrt(1.0 + dot(ray, ray)), measured > 0.0);
}

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn integrate(@builtin(global_invocation_id) id: vec3u) {
    let x = i32(id.x);
    let y = i32(id.y);
    let resolution = parameters.resolution;
    if ((parameters.conditional != 0 && state.tracked == 0) || x >= resolution || y >= resolution) {
        return;
    }
    let pose = pose_of(state.pose);
    let centre = (vec3f(f32(x), f32(y), 0.0) + 0.5) * parameters.voxel_size;
    let base = rotate_back(pose, centre - pose[3]);
    let slope = rotate_back(pose, vec3f(0.0, 0.0, parameters.voxel_size));
    let range = visible_range(base, slope, state.farthest + parameters.mu);
    for (var z = range.x; z <= range.y; z++) {
        let difference = measured_difference(base + f32(z) * slope);
        if (!(difference > -parameters.mu)) {
            continue;
        }
        let i = (z * resolution + y) * resolution + x;
        let word = voxels[i];
        let weight = f32(word >> 16u);
        let before = SCALE - f32(word & 0xffffu);
        let observed = min(difference * (SCALE / parameters.mu), SCALE);
        let mean = max((before * weight + observed) / (weight + 1.0), -SCALE);
        // Half to the next distance, also below zero: adding 32768.5 makes truncation round.
        let distance = i32(mean + 32768.5) - 32768;
        voxels[i] = u32(i32(SCALE) - distance) | (u32(min(weight + 1.0, parameters.max_weight)) << 16u);
        if (distance < i32(parameters.near_surface)) {
            atomicStore(&surface[((z / BLOCK) * parameters.blocks + y / BLOCK) * parameters.blocks + x / BLOCK], 1);
        }
    }
}
