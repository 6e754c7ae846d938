// Projective data association and the row of a point-to-plane error.
#include "normal_equations.wgsl"

// The pixel nearest to a projection; pixel (0, 0), and not visible, where that lies behind the camera or outside.
struct Pixel {
    visible: bool,
    column: i32,
    line: i32,
}

// `projected` holds image coordinates times the depth, and the depth.
fn nearest_pixel(projected: vec3f, width: i32, height: i32) -> Pixel {
    if (!(projected.z > 0.0)) {
        return Pixel(false, 0, 0);
    }
    let place = projected.xy / projected.z + 0.5;
    let inside = place.x >= 0.0 && place.x <= f32(width - 1) && place.y >= 0.0 && place.y <= f32(height - 1);
    if (!inside) {
        return Pixel(false, 0, 0);
    }
    // A comparison with NaN may hold here, so that the index is bounded as well.
    return Pixel(true, clamp(i32(place.x), 0, width - 1), clamp(i32(place.y), 0, height - 1));
}

// The row of a point, already moved, whose partner is `other`: zero unless both normals exist, the points lie within
// `max_distance` and the normals' product is `min_dot` or more (Newcombe et al. 2011, eq. 16 to 19).
fn point_to_plane(
    point: vec3f, normal: vec3f, other: vec3f, other_normal: vec3f, max_distance: f32, min_dot: f32,
) -> Equation {
    let difference = other - point;
    let inlier = dot(normal, normal) > 0.0 && dot(other_normal, other_normal) > 0.0
        && dot(difference, difference) <= max_distance * max_distance && dot(normal, other_normal) >= min_dot;
    if (!inlier) {
        return Equation(vec3f(0.0), vec3f(0.0), 0.0, 0.0);
    }
    return Equation(other_normal, cross(point, other_normal), dot(other_normal, difference), 1.0);
}
