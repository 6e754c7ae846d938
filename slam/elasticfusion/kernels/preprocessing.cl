// What the map needs of a colour image.
#include "shape.h"

// Three bytes a pixel to red | green << 8 | blue << 16. 0 says that there is no colour, so black becomes (1, 1, 1).
kernel void pack_colour(global const uchar *restrict bytes, global uint *restrict colour, int width, int height)
{
    EACH_PIXEL(x, y, width, height)
    {
        const int i = y * width + x;
        const uint packed = bytes[3 * i] | (bytes[3 * i + 1] << 8) | (bytes[3 * i + 2] << 16);
        colour[i] = packed ? packed : 0x010101;
    }
}
