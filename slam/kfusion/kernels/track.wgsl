// Point-to-plane ICP against the raycast model (Newcombe et al. 2011, section 3.5): the parts of the normal equations of
// an image, one record of SUMS floats per workgroup, and the number of pixels that see the model. The invocations take the
// pixels in turn.
#include "poses.wgsl"
#include "conditions.wgsl"
#include "association.wgsl"

@compute @workgroup_size(SUM_GROUP)
fn track(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    if (!is_wanted()) {
        return;
    }
    let camera = parameters.camera;
    let pose = pose_of(state.pose);
    let view = pose_of(state.view);
    let plane = parameters.width * parameters.height;
    let model_plane = parameters.model_width * parameters.model_height;
    var sums = Sums();
    for (var i = i32(id.x); i < plane; i += i32(groups.x) * SUM_GROUP) {
        let y = i / parameters.width;
        let x = i - y * parameters.width;
        let z = depth[i];
        let ray = vec3f((f32(x) - camera.z) / camera.x, (f32(y) - camera.w) / camera.y, 1.0);
        let point = move_point(pose, ray * z);
        let normal = rotate(pose, vec3f(normals[i], normals[plane + i], normals[2 * plane + i]));
        let pixel = nearest_pixel(move_point(view, point), parameters.model_width, parameters.model_height);
        if (!pixel.visible) {
            continue;
        }
        let m = pixel.line * parameters.model_width + pixel.column;
        let model_normal = vec3f(model_normals[m], model_normals[model_plane + m], model_normals[2 * model_plane + m]);
        sums.overlap += select(0.0, 1.0, z > 0.0 && dot(model_normal, model_normal) > 0.0);
        accumulate(&sums, point_to_plane(
            point,
            normal,
            vec3f(model_vertices[m], model_vertices[model_plane + m], model_vertices[2 * model_plane + m]),
            model_normal,
            parameters.max_distance,
            parameters.min_dot,
        ));
    }
    let sum = sum_of_group(sums, lane);
    if (lane < SUMS) {
        records[group.x * SUMS + lane] = sum;
    }
}
