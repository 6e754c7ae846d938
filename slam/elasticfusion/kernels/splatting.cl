// The map as a camera sees it: each surfel drawn as a disc (Whelan et al. 2016, section 3.2).
// `depths` and `ids` are working images with `stride` places a row: the depth along the optical axis of the nearest
// disc at each pixel, and whose it is.
#include "arithmetic.h"
#include "shape.h"
#include "surfels.h"
#include "view.h"

#define LANES 8 // pixels that are tried side by side in the layout by rows; `prediction.py` pads rows with as many

// No surfel anywhere.
kernel void clear_view(int stride, int height, global float *restrict depths, global int *restrict ids)
{
    EACH_PIXEL(x, y, stride, height)
    {
        depths[y * stride + x] = OUT_OF_SIGHT;
        ids[y * stride + x] = NOBODY;
    }
}

#ifdef PIXELS
// Where a pixel's ray meets a disc, as depth; OUT_OF_SIGHT where it misses.
INLINE float meet(Disc d, float plane, float ray_x, float ray_y)
{
    const float slope = d.nx * ray_x + d.ny * ray_y + d.nz;
    const float t = slope < 0.0f ? plane / slope : OUT_OF_SIGHT;
    const float dx = t * ray_x - d.x, dy = t * ray_y - d.y, dz = t - d.z;
    return dx * dx + dy * dy + dz * dz <= d.radius * d.radius ? t : OUT_OF_SIGHT;
}

// First the nearest depth at each pixel, then, where `choosing`, the smallest id of those who are that near. The two
// launches may round differently, so that a millionth of the depth counts as equal.
kernel void splat(int count, global const float *restrict place, global const float *restrict face,
                  global const int *restrict seen, global const View *restrict view, int width, int height,
                  float4 camera, int stride, int choosing, volatile global uint *depths, volatile global uint *ids)
{
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    EACH_SURFEL(i, count)
    {
        const Disc d = disc_of(place, face, i, matrix);
        if (!wanted(place[4 * i + 3], seen[i], view->confidence, view->first, view->last) || d.z > view->farthest)
            return;
        const Box box = box_of(d, camera, width, height);
        const float plane = d.nx * d.x + d.ny * d.y + d.nz * d.z;
        for (int y = box.top; y <= box.bottom; ++y)
            for (int x = box.left; x <= box.right; ++x) {
                const float t = meet(d, plane, (x - camera.z) / camera.x, (y - camera.w) / camera.y);
                const int pixel = y * stride + x;
                if (t >= OUT_OF_SIGHT)
                    continue;
                if (!choosing)
                    atomic_min(depths + pixel, as_uint(t)); // positive floats have the order of their bits
                else if (t <= as_float(depths[pixel]) * 1.000001f)
                    atomic_min(ids + pixel, (uint)i); // NOBODY is the largest
            }
    }
}
#else
// Draws one bin (of `binning.cl`): band `first` + `step` times the work-item. A disc may reach into the next band,
// so that neighbouring bands must not be drawn at once. Pixels of the box that the disc misses are left alone.
kernel void splat(global const float *restrict place, global const float *restrict face,
                  global const View *restrict view, int width, int height, float4 camera, int stride,
                  global const int *restrict starts, global const int *restrict sorted, int first, int step,
                  global float *restrict depths, global int *restrict ids)
{
    const int bin = first + step * get_global_id(0);
    const int begin = starts[bin], end = starts[bin + 1];
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    for (int entry = begin; entry < end; ++entry) {
        const int i = sorted[entry];
        const Disc d = disc_of(place, face, i, matrix);
        const Box box = box_of(d, camera, width, height);
        const float plane = d.nx * d.x + d.ny * d.y + d.nz * d.z, square = d.radius * d.radius;
        for (int y = box.top; y <= box.bottom; ++y) {
            const float ray_y = (y - camera.w) * inverse_fy, row_slope = d.ny * ray_y + d.nz;
            for (int left = box.left; left <= box.right; left += LANES) {
                global float *restrict depth = depths + y * stride + left;
                global int *restrict id = ids + y * stride + left;
                for (int l = 0; l < LANES; ++l) {
                    const float ray_x = (left + l - camera.z) * inverse_fx;
                    const float slope = d.nx * ray_x + row_slope;
                    const float t = plane / slope;
                    const float dx = t * ray_x - d.x, dy = t * ray_y - d.y, dz = t - d.z;
                    const int nearer = (slope < 0.0f) & (dx * dx + dy * dy + dz * dz <= square) &
                                       ((t < depth[l]) | ((t == depth[l]) & (i < id[l])));
                    depth[l] = nearer ? t : depth[l];
                    id[l] = nearer ? i : id[l];
                }
            }
        }
    }
}
#endif

// The attributes of the surfel that each pixel sees: an RGB-D image with its surfels' ages and confidences.
kernel void resolve(global const float *restrict depths, global const int *restrict ids, int stride, int width,
                    int height, global const float *restrict place, global const float *restrict face,
                    global const uint *restrict colours, global const int *restrict births,
                    global const View *restrict view, global float *restrict depth, global float *restrict normal_x,
                    global float *restrict normal_y, global float *restrict normal_z, global uint *restrict colour,
                    global int *restrict born, global float *restrict confidence)
{
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    EACH_PIXEL(x, y, width, height)
    {
        const int pixel = y * width + x, working = y * stride + x;
        const int covered = ids[working] != NOBODY, i = covered ? ids[working] : 0;
        const float nx = face[4 * i], ny = face[4 * i + 1], nz = face[4 * i + 2];
        depth[pixel] = covered ? depths[working] : 0.0f;
        normal_x[pixel] = covered ? row_of(matrix, 0, nx, ny, nz) : 0.0f;
        normal_y[pixel] = covered ? row_of(matrix, 1, nx, ny, nz) : 0.0f;
        normal_z[pixel] = covered ? row_of(matrix, 2, nx, ny, nz) : 0.0f;
        colour[pixel] = covered ? colours[i] : 0;
        born[pixel] = covered ? births[i] : 0;
        confidence[pixel] = covered ? place[4 * i + 3] : 0.0f;
    }
}

// How many pixels of each row are covered; one work-item per row.
kernel void covered_of_rows(global const float *restrict depth, int width, global int *restrict rows)
{
    const int y = get_global_id(0);
    int covered = 0;
    for (int x = 0; x < width; ++x)
        covered += depth[y * width + x] > 0.0f;
    rows[y] = covered;
}
