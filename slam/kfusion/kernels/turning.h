// Rotations between poses, as rotation vectors in the volume's axes. Include motion.h before.

// The angle between the axes of two poses, and the rotation vector that turns one's into the other's, in the volume's axes.
static inline float rotation_between(global const float *from, global const float *to, float w[3])
{
    float turn[3][3];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            turn[i][j] = to[4 * i] * from[4 * j] + to[4 * i + 1] * from[4 * j + 1] + to[4 * i + 2] * from[4 * j + 2];
    w[0] = 0.5f * (turn[2][1] - turn[1][2]);
    w[1] = 0.5f * (turn[0][2] - turn[2][0]);
    w[2] = 0.5f * (turn[1][0] - turn[0][1]);
    const float sine = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    const float angle = atan2(sine, 0.5f * (turn[0][0] + turn[1][1] + turn[2][2] - 1.0f));
    for (int i = 0; i < 3; ++i)
        w[i] *= sine > 1e-6f ? angle / sine : 1.0f;
    return angle;
}

// Turns a camera where it stands by a rotation vector in the volume's axes.
static inline void turn_camera(float x, float y, float z, global float *pose)
{
    const real twist[6] = {0, 0, 0, x, y, z};
    const float position[3] = {pose[3], pose[7], pose[11]};
    move_pose(twist, pose);
    for (int i = 0; i < 3; ++i)
        pose[4 * i + 3] = position[i];
}
