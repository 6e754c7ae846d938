// What the map needs of a colour image.
#include "shape.h"

// Every `ratio`-th pixel: three bytes to red | green << 8 | blue << 16. 0 says that there is no colour, so black becomes (1, 1, 1).
kernel void pack_colour(global const uchar *restrict bytes, int sensor_width, int ratio, global uint *restrict colour,
                        int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int i = 3 * (y * ratio * sensor_width + x * ratio);
        const uint packed = bytes[i] | (bytes[i + 1] << 8) | (bytes[i + 2] << 16);
        colour[y * width + x] = packed ? packed : 0x010101;
    }
}
