// A camera's pose, the surfels that it shows, and the pixels that a surfel's disc covers.

#define NO_SURFEL (-1) // the id at a pixel without a surfel

// `view.py` holds the same layout. `matrix` is 3x4, row by row.
typedef struct {
    float matrix[12]; // world to camera, metres
    float farthest;   // depth beyond which nothing is seen
    float confidence; // the least that is seen
    int first, last;  // ticks of the last measurement that are seen
} View;

// A surfel in the camera's frame.
typedef struct {
    float x, y, z, nx, ny, nz, radius;
} Disc;

// The pixels whose rays may meet a disc, sides included; nothing where right < left or bottom < top.
typedef struct {
    int left, right, top, bottom;
} Box;

INLINE float row_of(const float *matrix, int row, float x, float y, float z)
{
    return matrix[4 * row] * x + matrix[4 * row + 1] * y + matrix[4 * row + 2] * z;
}

// `position_confidence` and `normal_radius` are the map's arrays of (x, y, z, confidence) and (nx, ny, nz, radius).
INLINE Disc disc_of(global const float *restrict position_confidence, global const float *restrict normal_radius, int i,
                    const float *matrix)
{
    const float x = position_confidence[4 * i], y = position_confidence[4 * i + 1], z = position_confidence[4 * i + 2];
    const float nx = normal_radius[4 * i], ny = normal_radius[4 * i + 1], nz = normal_radius[4 * i + 2];
    Disc disc;
    disc.x = row_of(matrix, 0, x, y, z) + matrix[3];
    disc.y = row_of(matrix, 1, x, y, z) + matrix[7];
    disc.z = row_of(matrix, 2, x, y, z) + matrix[11];
    disc.nx = row_of(matrix, 0, nx, ny, nz);
    disc.ny = row_of(matrix, 1, nx, ny, nz);
    disc.nz = row_of(matrix, 2, nx, ny, nz);
    disc.radius = normal_radius[4 * i + 3];
    return disc;
}

// The least and the largest whole number from `a` to `b`, kept between 0 and size - 1.
INLINE int first_pixel(float a, int size)
{
    return bounded((int)(smaller(larger(a, -1.0f), size) + 1.99f) - 1, 0, size);
}

INLINE int last_pixel(float b, int size)
{
    return bounded((int)(smaller(larger(b, -1.0f), size) + 1.01f) - 1, -1, size - 1);
}

// Exact to a hundredth of a pixel: the planes through the camera's centre and a column of pixels that touch
// the disc. With k = (u - cx) / fx they satisfy (x - k z)^2 = r^2 (1 + k^2 - (nx - k nz)^2), a quadratic equation
// with two roots where all of the disc lies in front of the camera. Discs that do not, or face away, have no pixel.
INLINE Box box_of(Disc d, float4 camera, int width, int height)
{
    const float square = d.radius * d.radius;
    const float scale = d.z * d.z - square * (1.0f - d.nz * d.nz);
    const int in_front = (d.z > 0.0f) & (scale > 0.0f) & (d.nx * d.x + d.ny * d.y + d.nz * d.z < 0.0f);
    const float inverse = 1.0f / (in_front ? scale : 1.0f);
    const float across = d.x * d.nz - d.z * d.nx, along = d.y * d.nz - d.z * d.ny;
    const float under_x = larger(d.x * d.x + d.z * d.z - across * across - square * d.ny * d.ny, 1e-20f);
    const float under_y = larger(d.y * d.y + d.z * d.z - along * along - square * d.nx * d.nx, 1e-20f);
    const float half_width = d.radius * under_x * inverse_root(under_x) * inverse * magnitude(camera.x);
    const float half_height = d.radius * under_y * inverse_root(under_y) * inverse * magnitude(camera.y);
    const float u = (d.x * d.z + square * d.nx * d.nz) * inverse * camera.x + camera.z;
    const float v = (d.y * d.z + square * d.ny * d.nz) * inverse * camera.y + camera.w;
    Box box;
    box.left = first_pixel(u - half_width, width);
    box.right = in_front ? last_pixel(u + half_width, width) : -1;
    box.top = first_pixel(v - half_height, height);
    box.bottom = in_front ? last_pixel(v + half_height, height) : -1;
    return box;
}

// The one pixel nearest to a disc's middle, whichever way it faces.
INLINE Box pixel_of(Disc d, float4 camera, int width, int height)
{
    const int in_front = d.z > 0.0f;
    const float inverse = 1.0f / (in_front ? d.z : 1.0f);
    const float u = d.x * inverse * camera.x + camera.z + 0.5f, v = d.y * inverse * camera.y + camera.w + 0.5f;
    const int visible = in_front & (u >= 0.0f) & (u < width) & (v >= 0.0f) & (v < height);
    Box box;
    box.left = (int)(visible ? u : 0.0f);
    box.right = visible ? box.left : -1;
    box.top = (int)(visible ? v : 0.0f);
    box.bottom = visible ? box.top : -1;
    return box;
}

// Whether a view shows a surfel: removed ones have confidence 0.
INLINE int wanted(float confidence, int last_seen, float least_confidence, int first, int last)
{
    return (confidence > 0.0f) & (confidence >= least_confidence) & (last_seen >= first) & (last_seen <= last);
}
