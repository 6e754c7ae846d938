// Fusing a frame into the map: which surfel each pixel measures, the mean of both, and new surfels for the rest
// (Keller et al. 2013, sections 4.1 and 4.2; Whelan et al. 2015, section 3.1).
#include "arithmetic.h"
#include "shape.h"
#include "frame.h"

// The values of a match; 0 and above is a pixel of the index map, whose surfel matches.
#define NOTHING -2 // the pixel measures nothing
#define NEW -1     // the map does not hold what it measures

// Whether a pixel measures a surfel: its depth and those of its four neighbours are known, and so is its normal.
INLINE int measures(global const float *restrict raw, global const float *restrict normal_x,
                    global const float *restrict normal_y, global const float *restrict normal_z, int width,
                    int height, int x, int y)
{
    if (x < 1 || y < 1 || x >= width - 1 || y >= height - 1)
        return 0;
    const int i = y * width + x;
    const float nx = normal_x[i], ny = normal_y[i], nz = normal_z[i];
    return (raw[i] > 0.0f) & (raw[i - 1] > 0.0f) & (raw[i + 1] > 0.0f) & (raw[i - width] > 0.0f) &
           (raw[i + width] > 0.0f) & (nx * nx + ny * ny + nz * nz > 0.0f);
}

// The first frame: every pixel that measures anything is new.
kernel void all_new(global const float *restrict raw, global const float *restrict normal_x,
                    global const float *restrict normal_y, global const float *restrict normal_z, int width,
                    int height, global int *restrict matches)
{
    EACH_PIXEL(x, y, width, height)
    {
        matches[y * width + x] = measures(raw, normal_x, normal_y, normal_z, width, height, x, y) ? NEW : NOTHING;
    }
}

// Of the surfels that the index map holds around a pixel, those near its depth that face the same way; of these the
// one nearest to the pixel's ray, the first in the order of pixels among equals. A surfel seen at a slant need not face
// the same way: normals measured there are poor.
kernel void associate(global const float *restrict raw, global const float *restrict normal_x,
                      global const float *restrict normal_y, global const float *restrict normal_z, int width,
                      int height, float4 camera, global const int *restrict ids,
                      global const float4 *restrict position_confidence, global const float4 *restrict normal_radius,
                      global const Frame *restrict frame, float max_distance, float min_dot, float slanted,
                      global int *restrict matches)
{
    const int step = frame->step, phase = frame->phase;
    const int columns = (width + step - 1) / step, rows = (height + step - 1) / step;
    const float inverse_fx = 1.0f / camera.x, inverse_fy = 1.0f / camera.y;
    EACH_PIXEL(column, row, columns, rows)
    {
        const int x = step * column + phase, y = step * row + phase;
        int match = NOTHING;
        if (measures(raw, normal_x, normal_y, normal_z, width, height, x, y)) {
            match = NEW;
            const int i = y * width + x;
            const float z = raw[i], ray_x = (x - camera.z) * inverse_fx, ray_y = (y - camera.w) * inverse_fy;
            const float square = 1.0f + ray_x * ray_x + ray_y * ray_y;
            const float nearness = max_distance * inverse_root(square); // along the optical axis
            float nearest = MAXFLOAT;
            for (int dy = -1; dy <= 1; ++dy)
                for (int dx = -1; dx <= 1; ++dx) {
                    const int m = i + dy * width + dx;
                    const int id = ids[m];
                    if (id < 0)
                        continue;
                    const float3 p = to_camera(frame->pose, position_confidence[id].xyz);
                    if (!(magnitude(p.z - z) < nearness))
                        continue;
                    const float3 n = turned_to_camera(frame->pose, normal_radius[id].xyz);
                    const float dot = n.x * normal_x[i] + n.y * normal_y[i] + n.z * normal_z[i];
                    if (!(magnitude(n.z) < slanted || dot > min_dot))
                        continue;
                    // The part of p that lies across the ray, times the ray's length.
                    const float ax = p.x - ray_x * p.z, ay = p.y - ray_y * p.z, az = ray_x * p.y - ray_y * p.x;
                    const float across = ax * ax + ay * ay + az * az;
                    if (across < nearest) {
                        nearest = across;
                        match = m;
                    }
                }
        }
        matches[row * columns + column] = match;
    }
}

// The position (camera's frame) and radius of what a pixel measures: the position from the depth as measured, the
// radius from the filtered one. A disc covers its pixel's diagonal; one seen at a slant grows to twice that at most.
INLINE float4 measured(global const float *restrict raw, global const float *restrict filtered, float normal_z,
                       int width, float4 camera, int x, int y)
{
    const float z = raw[y * width + x];
    const float focal_length = 0.5f * (magnitude(camera.x) + magnitude(camera.y));
    const float radius = 1.41421356f * filtered[y * width + x] / focal_length;
    return (float4)((x - camera.z) / camera.x * z, (y - camera.w) / camera.y * z, z,
                    radius / larger(magnitude(normal_z), 0.5f));
}

INLINE uint mean_channel(uint old, uint fresh, int shift, float old_share)
{
    const float before = (old >> shift) & 0xff, after = (fresh >> shift) & 0xff;
    return (uint)(after + (before - after) * old_share + 0.5f) << shift;
}

// The weighted mean of a surfel and what the first pixel that matches it measures; pixels that match the same surfel
// lie beside each other. What would coarsen the surfel only confirms it.
kernel void update(global const float *restrict raw, global const float *restrict filtered,
                   global const float *restrict normal_x, global const float *restrict normal_y,
                   global const float *restrict normal_z, global const uint *restrict live_colour, int width,
                   int height, float4 camera, global const float *restrict share_x,
                   global const float *restrict share_y, global const int *restrict ids,
                   global const Frame *restrict frame, float max_coarsening, global const int *restrict matches,
                   global float4 *restrict position_confidence, global float4 *restrict normal_radius,
                   global uint *restrict colour, global int *restrict last_seen)
{
    const int step = frame->step, phase = frame->phase;
    const int columns = (width + step - 1) / step, rows = (height + step - 1) / step;
    EACH_PIXEL(column, row, columns, rows)
    {
        const int cell = row * columns + column;
        const int match = matches[cell];
        int first = match >= 0;
        if (first && column > 0)
            first = matches[cell - 1] != match;
        for (int other = bounded(column - 1, 0, columns - 1); first && row > 0 && other <= column + 1; ++other)
            first = other == columns || matches[cell - columns + other - column] != match;
        if (first) {
            const int x = step * column + phase, y = step * row + phase, i = y * width + x, id = ids[match];
            const float4 fresh = measured(raw, filtered, normal_z[i], width, camera, x, y);
            const float4 old_position = position_confidence[id], old_normal = normal_radius[id];
            const float confidence = frame->weight * share_x[x] * share_y[y];
            const float total = old_position.w + confidence;
            float4 new_position = old_position;
            if (fresh.w < max_coarsening * old_normal.w) {
                const float share = old_position.w / total;
                const float3 p = to_world(frame->pose, fresh.xyz);
                const float3 n = turned_to_world(frame->pose, (float3)(normal_x[i], normal_y[i], normal_z[i]));
                new_position.xyz = p + (old_position.xyz - p) * share;
                const float3 mean = n + (old_normal.xyz - n) * share;
                const float square = mean.x * mean.x + mean.y * mean.y + mean.z * mean.z;
                if (square > 0.0f)
                    normal_radius[id] =
                        (float4)(mean * inverse_root(square), fresh.w + (old_normal.w - fresh.w) * share);
                const uint old_colour = colour[id], seen_colour = live_colour[i];
                if (seen_colour)
                    colour[id] = old_colour ? mean_channel(old_colour, seen_colour, 0, share) |
                                                  mean_channel(old_colour, seen_colour, 8, share) |
                                                  mean_channel(old_colour, seen_colour, 16, share)
                                            : seen_colour;
            }
            new_position.w = total;
            position_confidence[id] = new_position;
            last_seen[id] = frame->tick;
        }
    }
}

// How many new surfels each row of matches brings. One work-item per row.
kernel void count_new(global const int *restrict matches, int columns, global int *restrict row_new)
{
    const int row = get_global_id(0);
    int total = 0;
    for (int column = 0; column < columns; ++column)
        total += matches[row * columns + column] == NEW;
    row_new[row] = total;
}

// Turns each row's number into that of all rows before it, and leaves the sum. One work-item.
kernel void scan_rows(global int *restrict row_new, int rows, global int *restrict total)
{
    int before = 0;
    for (int row = 0; row < rows; ++row) {
        const int here = row_new[row];
        row_new[row] = before;
        before += here;
    }
    *total = before;
}

// New surfels behind the map's last one, in the order of pixels. One work-item per row of matches. They are entered into
// the index map as well, where nothing nearer is; an empty map has none yet.
kernel void append(global const float *restrict raw, global const float *restrict filtered,
                   global const float *restrict normal_x, global const float *restrict normal_y,
                   global const float *restrict normal_z, global const uint *restrict live_colour, int width,
                   float4 camera, global const float *restrict share_x, global const float *restrict share_y,
                   global const Frame *restrict frame, global const int *restrict matches,
                   global const int *restrict row_new, global int *restrict ids,
                   global float4 *restrict position_confidence, global float4 *restrict normal_radius,
                   global uint *restrict colour, global int *restrict first_seen, global int *restrict last_seen)
{
    const int row = get_global_id(0), step = frame->step, phase = frame->phase;
    const int columns = (width + step - 1) / step;
    int id = frame->count + row_new[row];
    for (int column = 0; column < columns; ++column) {
        if (matches[row * columns + column] != NEW)
            continue;
        const int x = step * column + phase, y = step * row + phase, i = y * width + x;
        const float4 fresh = measured(raw, filtered, normal_z[i], width, camera, x, y);
        position_confidence[id] = (float4)(to_world(frame->pose, fresh.xyz), frame->weight * share_x[x] * share_y[y]);
        normal_radius[id] =
            (float4)(turned_to_world(frame->pose, (float3)(normal_x[i], normal_y[i], normal_z[i])), fresh.w);
        colour[id] = live_colour[i];
        first_seen[id] = frame->tick;
        last_seen[id] = frame->tick;
        if (frame->count > 0 && (ids[i] < 0 || to_camera(frame->pose, position_confidence[ids[i]].xyz).z > fresh.z))
            ids[i] = id;
        ++id;
    }
}
