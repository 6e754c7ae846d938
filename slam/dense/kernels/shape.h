// How kernels over an image are laid out; the host chooses by the kind of device and says -DPIXELS or not.
// Rows: one work-item walks a row in a plain loop, which compilers for CPUs turn into vector code.
// Pixels: one work-item per pixel, neighbours in x side by side, as GPUs want it.
#ifdef PIXELS
#define EACH_PIXEL(x, y, width, height)                                                                                \
    const int x = get_global_id(0), y = get_global_id(1);                                                              \
    if (x < (width) && y < (height))
#else
#define EACH_PIXEL(x, y, width, height)                                                                                \
    const int y = get_global_id(0);                                                                                    \
    for (int x = 0; x < (width); ++x)
#endif
