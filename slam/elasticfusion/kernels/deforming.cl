// Moving the map with its deformation graph (Sumner et al. 2007, section 4; Whelan et al. 2015, section 5).
#include "arithmetic.h"
#include "surfels.h"

#define NODE 16      // floats of a node: position, rotation row by row, translation, one unused
#define NEIGHBOURS 4 // nodes that move a surfel

// Each surfel's position and normal, moved by the nearest of the nodes that its first tick allows: `windows` holds the
// first and the last but one of them for each tick. Nodes are numbered by first tick; of equals, the earlier counts.
kernel void deform(int count, global const float *restrict nodes, global const int2 *restrict windows,
                   global const int *restrict first_seen, global float4 *restrict position_confidence,
                   global float4 *restrict normal_radius)
{
    EACH_SURFEL(i, count)
    {
        const float4 p = position_confidence[i];
        if (p.w > 0.0f) {
            float squares[NEIGHBOURS + 1]; // ascending, of the nodes in `nearest`
            int nearest[NEIGHBOURS + 1];
            for (int k = 0; k <= NEIGHBOURS; ++k) {
                squares[k] = MAXFLOAT;
                nearest[k] = 0;
            }
            const int2 window = windows[first_seen[i]];
            for (int node = window.x; node < window.y; ++node) {
                const float dx = p.x - nodes[node * NODE], dy = p.y - nodes[node * NODE + 1];
                const float dz = p.z - nodes[node * NODE + 2];
                const float square = dx * dx + dy * dy + dz * dz;
                if (!(square < squares[NEIGHBOURS]))
                    continue;
                int k = NEIGHBOURS;
                for (; k > 0 && square < squares[k - 1]; --k) {
                    squares[k] = squares[k - 1];
                    nearest[k] = nearest[k - 1];
                }
                squares[k] = square;
                nearest[k] = node;
            }

            float weights[NEIGHBOURS], total = 0.0f;
            const float farthest = sqrt(squares[NEIGHBOURS]);
            for (int k = 0; k < NEIGHBOURS; ++k) {
                const float nearness = farthest > 0.0f ? 1.0f - sqrt(squares[k]) / farthest : 0.0f;
                weights[k] = nearness * nearness;
                total += weights[k];
            }
            float moved[3] = {0.0f, 0.0f, 0.0f}, linear[9] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
            for (int k = 0; k < NEIGHBOURS; ++k) {
                global const float *restrict node = nodes + nearest[k] * NODE;
                const float weight = total > 0.0f ? weights[k] / total : 1.0f / NEIGHBOURS;
                const float dx = p.x - node[0], dy = p.y - node[1], dz = p.z - node[2];
                for (int row = 0; row < 3; ++row) {
                    global const float *restrict turn = node + 3 + 3 * row;
                    moved[row] += weight * (turn[0] * dx + turn[1] * dy + turn[2] * dz + node[row] + node[12 + row]);
                    for (int column = 0; column < 3; ++column)
                        linear[3 * row + column] += weight * turn[column];
                }
            }
            position_confidence[i] = (float4)(moved[0], moved[1], moved[2], p.w);

            // Normals transform by the inverse transpose; the matrix of cofactors equals it up to a factor.
            const float4 n = normal_radius[i];
            const float3 x = (float3)(linear[0], linear[1], linear[2]), y = (float3)(linear[3], linear[4], linear[5]);
            const float3 z = (float3)(linear[6], linear[7], linear[8]);
            const float3 turned = (float3)(dot(cross(y, z), n.xyz), dot(cross(z, x), n.xyz), dot(cross(x, y), n.xyz));
            const float square = dot(turned, turned);
            if (square > 0.0f)
                normal_radius[i] = (float4)(turned * inverse_root(square), n.w);
        }
    }
}

// A stable surfel that a camera sees in front of what `depth` holds there, or at most `behind` metres behind it, counts
// as seen at `tick`: the old surface that a loop was closed with becomes active again. `view`: world to camera, 3x4.
kernel void reactivate(int count, global const float4 *restrict position_confidence, global int *restrict last_seen,
                       global const float *restrict depth, int width, int height, float4 camera,
                       global const float *restrict view, float threshold, float behind, int tick)
{
    EACH_SURFEL(i, count)
    {
        const float4 p = position_confidence[i];
        const float z = view[8] * p.x + view[9] * p.y + view[10] * p.z + view[11];
        const float inverse = 1.0f / z;
        const float u = camera.x * (view[0] * p.x + view[1] * p.y + view[2] * p.z + view[3]) * inverse + camera.z + 0.5f;
        const float v = camera.y * (view[4] * p.x + view[5] * p.y + view[6] * p.z + view[7]) * inverse + camera.w + 0.5f;
        const int visible =
            (p.w >= threshold) & (z > 0.0f) & (u >= 0.0f) & (u < width) & (v >= 0.0f) & (v < height);
        const float surface = depth[visible ? (int)v * width + (int)u : 0];
        if (visible & (surface > 0.0f) & (z < surface + behind))
            last_seen[i] = tick;
    }
}

// The first surfel of every `every` places; confidence 0 where there is none. One work-item per node.
kernel void sample_nodes(int count, int every, global const float4 *restrict position_confidence,
                         global const int *restrict first_seen, global float4 *restrict sampled,
                         global int *restrict times)
{
    const int node = get_global_id(0);
    const int end = bounded((node + 1) * every, 0, count);
    float4 found = (float4)(0.0f);
    int time = 0;
    for (int i = node * every; i < end; ++i)
        if (position_confidence[i].w > 0.0f) {
            found = position_confidence[i];
            time = first_seen[i];
            break;
        }
    sampled[node] = found;
    times[node] = time;
}
