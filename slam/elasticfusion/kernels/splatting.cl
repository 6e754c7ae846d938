// The map as a camera sees it: each surfel drawn as a disc (Whelan et al. 2016, section 3.2).
// `nearness` and `ids` are working images with `stride` places a row: how near the nearest disc is at each pixel, and
// whose it is. Nearness is the inverse of the depth along the optical axis, but discs are compared as if they were
// bent backwards: where they overlap, the one is seen whose middle is nearest to the ray. Otherwise the rims of flat
// discs stand out of every curved or creased surface, and of the many discs of a noisy one the nearest are seen, so that
// surfaces seem nearer than they are.
#include "arithmetic.h"
#include "shape.h"
#include "surfels.h"
#include "view.h"

#define LANES 8   // pixels that are tried side by side in the layout by rows, by which rows are padded
#define BATCH 16  // discs that are made ready side by side there
#define BEND 8.0f // radii that a disc's rim is bent backwards

// A disc as rays see it that are off the one through its middle by (x, y): the inverse of the depth at which a ray
// meets its plane is linear, inverse + inverse_x x + inverse_y y, and it meets the disc itself where
// rim = xx x^2 + xy x y + yy y^2 <= square (inverse depth)^2. Both follow from the ray's depth n.p / n.ray, and
// nothing has to be divided at a pixel. At distance s from its middle the disc is bent backwards by BEND s^2 / radius,
// which takes rim * bend from the inverse depth.
typedef struct {
    float ray_x, ray_y, inverse, inverse_x, inverse_y, xx, xy, yy, square, bend;
} Sheet;

INLINE Sheet sheet_of(Disc d)
{
    const float plane = d.nx * d.x + d.ny * d.y + d.nz * d.z, distance = d.x * d.x + d.y * d.y + d.z * d.z;
    const float over_plane = 1.0f / plane;
    Sheet sheet;
    sheet.inverse = 1.0f / d.z;
    sheet.ray_x = d.x * sheet.inverse;
    sheet.ray_y = d.y * sheet.inverse;
    sheet.inverse_x = d.nx * over_plane;
    sheet.inverse_y = d.ny * over_plane;
    sheet.xx = 1.0f + sheet.inverse_x * (distance * sheet.inverse_x - 2.0f * d.x);
    sheet.yy = 1.0f + sheet.inverse_y * (distance * sheet.inverse_y - 2.0f * d.y);
    sheet.xy = 2.0f * (distance * sheet.inverse_x * sheet.inverse_y - d.x * sheet.inverse_y - d.y * sheet.inverse_x);
    sheet.square = d.radius * d.radius;
    sheet.bend = BEND / d.radius;
    return sheet;
}

// No surfel anywhere.
kernel void clear_view(int stride, int height, global float *restrict nearness, global int *restrict ids)
{
    EACH_PIXEL(x, y, stride, height)
    {
        nearness[y * stride + x] = 0.0f;
        ids[y * stride + x] = NO_SURFEL;
    }
}

#ifdef PIXELS
// First the largest nearness at each pixel, then, where `choosing`, the smallest id of those that are that near. The
// two launches may round differently, so that a millionth counts as equal.
kernel void splat(int count, global const float *restrict position_confidence,
                  global const float *restrict normal_radius, global const int *restrict last_seen,
                  global const View *restrict view, int width, int height, float4 camera, int stride, int choosing,
                  volatile global uint *nearness, volatile global uint *ids)
{
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    EACH_SURFEL(i, count)
    {
        const Disc d = disc_of(position_confidence, normal_radius, i, matrix);
        if (!wanted(position_confidence[4 * i + 3], last_seen[i], view->confidence, view->first, view->last) ||
            d.z > view->farthest)
            return;
        const Box box = box_of(d, camera, width, height);
        const Sheet sheet = sheet_of(d);
        for (int row = box.top; row <= box.bottom; ++row)
            for (int column = box.left; column <= box.right; ++column) {
                const float x = (column - camera.z) / camera.x - sheet.ray_x;
                const float y = (row - camera.w) / camera.y - sheet.ray_y;
                const float inverse = sheet.inverse + sheet.inverse_x * x + sheet.inverse_y * y;
                const float rim = sheet.xx * x * x + sheet.xy * x * y + sheet.yy * y * y;
                const int pixel = row * stride + column;
                const float key = inverse - rim * sheet.bend;
                if (!(key > 0.0f && rim <= sheet.square * inverse * inverse))
                    continue;
                if (!choosing)
                    atomic_max(nearness + pixel, as_uint(key)); // positive floats have the order of their bits
                else if (key >= as_float(nearness[pixel]) * 0.999999f)
                    atomic_min(ids + pixel, (uint)i); // NO_SURFEL is the largest
            }
    }
}
#else
// Draws one bin (of `binning.cl`): band `first` + `step` times the work-item. A disc may reach into the next band,
// so that neighbouring bands must not be drawn at once.
kernel void splat(global const float *restrict position_confidence, global const float *restrict normal_radius,
                  global const View *restrict view, int width, int height, float4 camera, int stride,
                  global const int *restrict starts, global const int *restrict sorted, int first, int step,
                  global float *restrict nearness, global int *restrict ids)
{
    const int bin = first + step * get_global_id(0);
    const int begin = starts[bin], end = starts[bin + 1];
    const float step_x = 1.0f / camera.x, step_y = 1.0f / camera.y;
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    for (int start = begin; start < end; start += BATCH) {
        const int size = end - start < BATCH ? end - start : BATCH;
        Sheet sheets[BATCH];
        Box boxes[BATCH];
        for (int b = 0; b < BATCH; ++b) {
            const Disc disc = disc_of(position_confidence, normal_radius, sorted[start + (b < size ? b : 0)], matrix);
            boxes[b] = box_of(disc, camera, width, height);
            sheets[b] = sheet_of(disc);
        }
        for (int b = 0; b < size; ++b) {
            const Box box = boxes[b];
            const Sheet sheet = sheets[b];
            const int i = sorted[start + b];
            for (int row = box.top; row <= box.bottom; ++row) {
                const float y = (row - camera.w) * step_y - sheet.ray_y;
                const float row_inverse = sheet.inverse + sheet.inverse_y * y;
                const float row_slope = sheet.xy * y, row_rim = sheet.yy * y * y;
                for (int left = box.left; left <= box.right; left += LANES) {
                    global float *restrict near = nearness + row * stride + left;
                    global int *restrict id = ids + row * stride + left;
                    const float left_x = (left - camera.z) * step_x - sheet.ray_x;
                    for (int l = 0; l < LANES; ++l) {
                        const float x = left_x + l * step_x;
                        const float inverse = row_inverse + sheet.inverse_x * x;
                        const float rim = (sheet.xx * x + row_slope) * x + row_rim;
                        const float key = inverse - rim * sheet.bend;
                        const int nearer = (rim <= sheet.square * inverse * inverse) & (key > near[l]);
                        near[l] = nearer ? key : near[l];
                        id[l] = nearer ? i : id[l];
                    }
                }
            }
        }
    }
}
#endif

// The attributes of the surfel that each pixel sees: an RGB-D image with its surfels' ages and confidences.
kernel void resolve(global const int *restrict ids, int stride, int width, int height, float4 camera,
                    global const float *restrict position_confidence, global const float *restrict normal_radius,
                    global const uint *restrict colours, global const int *restrict first_ticks,
                    global const View *restrict view, global float *restrict depth, global float *restrict normal_x,
                    global float *restrict normal_y, global float *restrict normal_z, global uint *restrict colour,
                    global int *restrict first_seen, global float *restrict confidence)
{
    const float step_x = 1.0f / camera.x, step_y = 1.0f / camera.y;
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    EACH_PIXEL(x, y, width, height)
    {
        const int pixel = y * width + x, working = y * stride + x;
        const int covered = ids[working] != NO_SURFEL, i = covered ? ids[working] : 0;
        const Disc d = disc_of(position_confidence, normal_radius, i, matrix);
        const float ray_x = (x - camera.z) * step_x, ray_y = (y - camera.w) * step_y;
        const float plane = d.nx * d.x + d.ny * d.y + d.nz * d.z;
        depth[pixel] = covered ? plane / (d.nx * ray_x + d.ny * ray_y + d.nz) : 0.0f;
        normal_x[pixel] = covered ? d.nx : 0.0f;
        normal_y[pixel] = covered ? d.ny : 0.0f;
        normal_z[pixel] = covered ? d.nz : 0.0f;
        colour[pixel] = covered ? colours[i] : 0;
        first_seen[pixel] = covered ? first_ticks[i] : 0;
        confidence[pixel] = covered ? position_confidence[4 * i + 3] : 0.0f;
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
