// Rotations between poses, as rotation vectors in the volume's axes.
#include "solving.wgsl"

struct Turn {
    vector: vec3f,
    angle: f32,
}

// What turns the axes of one pose into those of another.
fn rotation_between(before: mat4x3f, after: mat4x3f) -> Turn {
    let turn = mat3x3f(after[0], after[1], after[2]) * transpose(mat3x3f(before[0], before[1], before[2]));
    let axis = 0.5 * vec3f(turn[1].z - turn[2].y, turn[2].x - turn[0].z, turn[0].y - turn[1].x);
    let sine = length(axis);
    let angle = atan2(sine, 0.5 * (turn[0].x + turn[1].y + turn[2].z - 1.0));
    return Turn(axis * select(1.0, angle / sine, sine > 1e-6), angle);
}

// A camera turned where it stands.
fn turned_by(vector: vec3f, pose: mat4x3f) -> mat4x3f {
    var turned = moved_by(Vector6(0.0, 0.0, 0.0, vector.x, vector.y, vector.z), pose);
    turned[3] = pose[3];
    return turned;
}
