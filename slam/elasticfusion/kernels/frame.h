// The frame that is fused, and the way between the camera's frame and the world; `fusion.py` holds the same layout.
typedef struct {
    float pose[12]; // camera to world, 3x4 row by row, metres
    float weight;   // of the frame's measurements, by the camera's speed
    int tick;
    int step;  // every step-th pixel of every step-th row is fused,
    int phase; // from this one on
    int count; // surfels before the frame
} Frame;

INLINE float3 to_world(global const float *restrict pose, float3 p)
{
    return (float3)(pose[0] * p.x + pose[1] * p.y + pose[2] * p.z + pose[3],
                    pose[4] * p.x + pose[5] * p.y + pose[6] * p.z + pose[7],
                    pose[8] * p.x + pose[9] * p.y + pose[10] * p.z + pose[11]);
}

INLINE float3 turned_to_world(global const float *restrict pose, float3 v)
{
    return (float3)(pose[0] * v.x + pose[1] * v.y + pose[2] * v.z, pose[4] * v.x + pose[5] * v.y + pose[6] * v.z,
                    pose[8] * v.x + pose[9] * v.y + pose[10] * v.z);
}

INLINE float3 turned_to_camera(global const float *restrict pose, float3 v)
{
    return (float3)(pose[0] * v.x + pose[4] * v.y + pose[8] * v.z, pose[1] * v.x + pose[5] * v.y + pose[9] * v.z,
                    pose[2] * v.x + pose[6] * v.y + pose[10] * v.z);
}

INLINE float3 to_camera(global const float *restrict pose, float3 p)
{
    return turned_to_camera(pose, (float3)(p.x - pose[3], p.y - pose[7], p.z - pose[11]));
}
