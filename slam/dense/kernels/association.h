// Projective data association and the row of a point-to-plane error. Free of branches: what is rejected counts with
// weight 0, and an index is only trusted after its bounds test, which NaN fails. Include least_squares.h before.

typedef struct {
    float x, y, z;
} Vector;

INLINE Vector vector(float x, float y, float z)
{
    const Vector v = {x, y, z};
    return v;
}

INLINE float dot_product(Vector a, Vector b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// A point moved by `pose`, three rows of rotation and translation, and a direction turned by it.
INLINE Vector moved(const float *pose, Vector p)
{
    return vector(pose[0] * p.x + pose[1] * p.y + pose[2] * p.z + pose[3],
                  pose[4] * p.x + pose[5] * p.y + pose[6] * p.z + pose[7],
                  pose[8] * p.x + pose[9] * p.y + pose[10] * p.z + pose[11]);
}

INLINE Vector turned(const float *pose, Vector d)
{
    return vector(pose[0] * d.x + pose[1] * d.y + pose[2] * d.z, pose[4] * d.x + pose[5] * d.y + pose[6] * d.z,
                  pose[8] * d.x + pose[9] * d.y + pose[10] * d.z);
}

// The pixel nearest to a projection; pixel 0, and not visible, where that lies behind the camera or outside.
typedef struct {
    int visible, column, line;
} Pixel;

// (x, y) are image coordinates times the depth.
INLINE Pixel nearest_pixel(float x, float y, float depth, int width, int height)
{
    const float inverse = 1.0f / depth;
    const float u = x * inverse + 0.5f, v = y * inverse + 0.5f;
    const float right = width - 1, bottom = height - 1;
    Pixel pixel;
    pixel.visible = (depth > 0.0f) & (u >= 0.0f) & (u <= right) & (v >= 0.0f) & (v <= bottom);
    pixel.column = (int)(pixel.visible ? u : 0.0f);
    pixel.line = (int)(pixel.visible ? v : 0.0f);
    return pixel;
}

// The row of a point, already moved, whose partner is `target`: zero unless it is `possible`, both normals exist, the
// points lie within `max_distance` and the normals' product is `min_dot` or more (Newcombe et al. 2011, eq. 16 to 19).
INLINE Equation point_to_plane(int possible, Vector point, Vector normal, Vector target, Vector target_normal,
                               float max_distance, float min_dot)
{
    const Vector difference = vector(target.x - point.x, target.y - point.y, target.z - point.z);
    const int inlier = possible & (dot_product(normal, normal) > 0.0f) &
                       (dot_product(target_normal, target_normal) > 0.0f) &
                       (dot_product(difference, difference) <= max_distance * max_distance) &
                       (dot_product(normal, target_normal) >= min_dot);
    const float w = inlier ? 1.0f : 0.0f;

    Equation equation;
    equation.j0 = w * target_normal.x;
    equation.j1 = w * target_normal.y;
    equation.j2 = w * target_normal.z;
    equation.j3 = w * (point.y * target_normal.z - point.z * target_normal.y);
    equation.j4 = w * (point.z * target_normal.x - point.x * target_normal.z);
    equation.j5 = w * (point.x * target_normal.y - point.y * target_normal.x);
    equation.error = w * dot_product(target_normal, difference);
    equation.weight = w;
    return equation;
}
