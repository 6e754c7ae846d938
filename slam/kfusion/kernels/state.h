// What tracking keeps on the device between kernels and frames; `pipeline.py` holds the same layout.
// Matrices are 3x4, row by row: three rows of rotation and translation.
typedef struct {
    float pose[12];      // camera to volume, metres
    float previous[12];  // the pose before this frame's tracking
    float view[12];      // volume to model pixels: intrinsics times the inverse of the model's pose
    float squared_error; // of the level and iteration solved last
    float inliers;
    int converged;       // the current level needs no further iteration
    int tracked;         // the last pose check passed
    float farthest;      // largest depth of the frame, metres
} State;
