// How kernels over the map's surfels are laid out; `surfels.py` launches them so. Rows: a work-item walks a run of
// RUN surfels in a plain loop. Pixels: one work-item per surfel. Either way a surfel's run is `i / RUN`.
#define RUN 1024

#ifdef PIXELS
#define EACH_SURFEL(i, count)                                                                                          \
    const int i = get_global_id(0);                                                                                    \
    if (i < (count))
#else
#define EACH_SURFEL(i, count)                                                                                          \
    const int first_of_run = get_global_id(0) * RUN;                                                                   \
    const int end_of_run = first_of_run + RUN < (count) ? first_of_run + RUN : (count);                               \
    for (int i = first_of_run; i < end_of_run; ++i)
#endif
