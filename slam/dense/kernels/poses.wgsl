// A pose lies in the state as three rows of rotation and translation; here it is a matrix of four columns.

fn pose_of(rows: array<f32, 12>) -> mat4x3f {
    return mat4x3f(
        rows[0], rows[4], rows[8],
        rows[1], rows[5], rows[9],
        rows[2], rows[6], rows[10],
        rows[3], rows[7], rows[11],
    );
}

fn rows_of(pose: mat4x3f) -> array<f32, 12> {
    return array<f32, 12>(
        pose[0].x, pose[1].x, pose[2].x, pose[3].x,
        pose[0].y, pose[1].y, pose[2].y, pose[3].y,
        pose[0].z, pose[1].z, pose[2].z, pose[3].z,
    );
}

fn move_point(pose: mat4x3f, point: vec3f) -> vec3f {
    return pose * vec4f(point, 1.0);
}

fn rotate(pose: mat4x3f, direction: vec3f) -> vec3f {
    return pose * vec4f(direction, 0.0);
}

// The rotation's inverse, applied to a direction.
fn rotate_back(pose: mat4x3f, direction: vec3f) -> vec3f {
    return direction * mat3x3f(pose[0], pose[1], pose[2]);
}
