// Which surfel lies nearest behind each pixel: every surfel counts at the one pixel that its middle falls into.
#include "arithmetic.h"
#include "shape.h"
#include "surfels.h"
#include "view.h"

#define BATCH 16 // surfels that are projected side by side in the layout by rows

#define OUT_OF_SIGHT 1e30f // depth of a pixel without a surfel

// No surfel anywhere.
kernel void clear_index(int width, int height, global float *restrict depths, global int *restrict ids)
{
    EACH_PIXEL(x, y, width, height)
    {
        depths[y * width + x] = OUT_OF_SIGHT;
        ids[y * width + x] = NO_SURFEL;
    }
}

#ifdef PIXELS
// First the nearest depth at each pixel, then, where `choosing`, the smallest id of those that are that near. The two
// launches may round differently, so that a millionth of the depth counts as equal.
kernel void index_surfels(int count, global const float *restrict position_confidence,
                          global const float *restrict normal_radius, global const int *restrict last_seen,
                          global const View *restrict view, int width, int height, float4 camera, int choosing,
                          volatile global uint *depths, volatile global uint *ids)
{
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    EACH_SURFEL(i, count)
    {
        const Disc d = disc_of(position_confidence, normal_radius, i, matrix);
        const Box box = pixel_of(d, camera, width, height);
        if (!wanted(position_confidence[4 * i + 3], last_seen[i], view->confidence, view->first, view->last) ||
            d.z > view->farthest || box.right < 0)
            return;
        const int pixel = box.top * width + box.left;
        if (!choosing)
            atomic_min(depths + pixel, as_uint(d.z)); // positive floats have the order of their bits
        else if (d.z <= as_float(depths[pixel]) * 1.000001f)
            atomic_min(ids + pixel, (uint)i); // NO_SURFEL is the largest
    }
}
#else
// One band of the image (a bin of `binning.cl`) per work-item.
kernel void index_surfels(global const float *restrict position_confidence, global const float *restrict normal_radius,
                          global const View *restrict view, int width, int height, float4 camera,
                          global const int *restrict starts, global const int *restrict sorted,
                          global float *restrict depths, global int *restrict ids)
{
    const int band = get_global_id(0);
    const int begin = starts[band], end = starts[band + 1];
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    for (int start = begin; start < end; start += BATCH) {
        const int size = end - start < BATCH ? end - start : BATCH;
        int pixels[BATCH];
        float found[BATCH];
        for (int b = 0; b < BATCH; ++b) {
            const Disc d = disc_of(position_confidence, normal_radius, sorted[start + (b < size ? b : 0)], matrix);
            const Box box = pixel_of(d, camera, width, height);
            pixels[b] = box.right < 0 ? -1 : box.top * width + box.left;
            found[b] = d.z;
        }
        for (int b = 0; b < size; ++b) {
            const int pixel = pixels[b];
            if (pixel >= 0 && found[b] < depths[pixel]) { // ids ascend: of equals the first stays
                depths[pixel] = found[b];
                ids[pixel] = sorted[start + b];
            }
        }
    }
}
#endif
