// Which surfels a camera sees, sorted into bands of its image, so that each band is drawn by one work-item and
// needs no atomics. For the layout by rows. A surfel's bin is the band of its topmost row; a disc that reaches
// beyond the following band goes into one more bin, the last.
#include "arithmetic.h"
#include "surfels.h"
#include "view.h"

#define BAND 16 // rows

INLINE int bin_of(Box box, int bands)
{
    const int band = box.top / BAND;
    return box.bottom >= (band + 2) * BAND ? bands : band;
}

// The surfels of each run that are seen, in order, at the run's place in `seen_ids`, their bins beside them in
// `seen_bins`, how many they are in `seen_counts`, and how many of each bin in `bin_counts`, bin after bin.
INLINE void cull(int whole_discs, int count, global const float *restrict position_confidence,
                 global const float *restrict normal_radius, global const int *restrict last_seen,
                 global const View *restrict view, int width, int height, float4 camera, int bands,
                 global int *restrict seen_ids, global ushort *restrict seen_bins, global int *restrict seen_counts,
                 global int *restrict bin_counts)
{
    const int run = get_global_id(0), runs = (count + RUN - 1) / RUN;
    const int start = run * RUN, size = count - start < RUN ? count - start : RUN;
    const int first = view->first, last = view->last;
    const float farthest = view->farthest, confidence = view->confidence;
    float matrix[12];
    for (int k = 0; k < 12; ++k)
        matrix[k] = view->matrix[k];
    for (int bin = 0; bin <= bands; ++bin)
        bin_counts[bin * runs + run] = 0;

    int any = 0;
    for (int k = 0; k < size; ++k)
        any |= (last_seen[start + k] >= first) & (last_seen[start + k] <= last);
    seen_counts[run] = 0;
    if (!any)
        return;

    int bins[RUN];
    for (int k = 0; k < size; ++k) {
        const int i = start + k;
        const Disc disc = disc_of(position_confidence, normal_radius, i, matrix);
        const Box box = whole_discs ? box_of(disc, camera, width, height) : pixel_of(disc, camera, width, height);
        const int visible = wanted(position_confidence[4 * i + 3], last_seen[i], confidence, first, last) &
                            (disc.z <= farthest) & (box.left <= box.right) & (box.top <= box.bottom);
        bins[k] = visible ? bin_of(box, bands) : -1;
    }
    int found = 0;
    for (int k = 0; k < size; ++k)
        if (bins[k] >= 0) {
            seen_ids[start + found] = start + k;
            seen_bins[start + found] = bins[k];
            ++found;
            ++bin_counts[bins[k] * runs + run];
        }
    seen_counts[run] = found;
}

// A surfel is seen where its disc may cover a pixel's middle.
kernel void cull_discs(int count, global const float *restrict position_confidence,
                       global const float *restrict normal_radius, global const int *restrict last_seen,
                       global const View *restrict view, int width, int height, float4 camera, int bands,
                       global int *restrict seen_ids, global ushort *restrict seen_bins,
                       global int *restrict seen_counts, global int *restrict bin_counts)
{
    cull(1, count, position_confidence, normal_radius, last_seen, view, width, height, camera, bands, seen_ids,
         seen_bins, seen_counts, bin_counts);
}

// A surfel is seen where its middle lies in the image.
kernel void cull_points(int count, global const float *restrict position_confidence,
                        global const float *restrict normal_radius, global const int *restrict last_seen,
                        global const View *restrict view, int width, int height, float4 camera, int bands,
                        global int *restrict seen_ids, global ushort *restrict seen_bins,
                        global int *restrict seen_counts, global int *restrict bin_counts)
{
    cull(0, count, position_confidence, normal_radius, last_seen, view, width, height, camera, bands, seen_ids,
         seen_bins, seen_counts, bin_counts);
}

// How many surfels come before each run's in each bin; `starts` is where the bins begin and where the last ends.
// One work-item.
kernel void bin_offsets(int count, int bands, global int *restrict bin_counts, global int *restrict starts)
{
    const int runs = (count + RUN - 1) / RUN;
    int total = 0;
    for (int bin = 0; bin <= bands; ++bin) {
        starts[bin] = total;
        for (int run = 0; run < runs; ++run) {
            const int here = bin_counts[bin * runs + run];
            bin_counts[bin * runs + run] = total;
            total += here;
        }
    }
    starts[bands + 1] = total;
}

// The seen surfels bin after bin, in each by ascending id. `bin_offsets` is used up.
kernel void scatter(int count, global const int *restrict seen_ids, global const ushort *restrict seen_bins,
                    global const int *restrict seen_counts, global int *restrict bin_offsets,
                    global int *restrict sorted)
{
    const int run = get_global_id(0), runs = (count + RUN - 1) / RUN;
    const int found = seen_counts[run];
    for (int k = run * RUN; k < run * RUN + found; ++k)
        sorted[bin_offsets[seen_bins[k] * runs + run]++] = seen_ids[k];
}
