// The normal equations of a motion's six unknowns, summed over an image. Include arithmetic.h before.
// What a record holds: 21 of J^T J (upper triangle), 6 of J^T e, the sum of e^2, the number of inliers; 29 and 30 are a kernel's own, 31
// stays free.

// One pixel's row of the least-squares problem: the gradient of its error by the twist, and the error; all
// zero, with weight 0, where it has no partner.
typedef struct {
    float j0, j1, j2, j3, j4, j5, error, weight;
} Equation;

// 31 separate sums, so that each can live in a vector register.
#define DECLARE_SUMS                                                                                                   \
    float s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0, s6 = 0, s7 = 0, s8 = 0, s9 = 0, s10 = 0, s11 = 0, s12 = 0,  \
          s13 = 0, s14 = 0, s15 = 0, s16 = 0, s17 = 0, s18 = 0, s19 = 0, s20 = 0, s21 = 0, s22 = 0, s23 = 0, s24 = 0, \
          s25 = 0, s26 = 0, s27 = 0, s28 = 0, s29 = 0, s30 = 0;

// Adds an equation's row to the first 27 sums, and the whole of it to the first 29.
#define ACCUMULATE_ROW(q)                                                                                                  \
    s0 += q.j0 * q.j0, s1 += q.j0 * q.j1, s2 += q.j0 * q.j2, s3 += q.j0 * q.j3, s4 += q.j0 * q.j4, s5 += q.j0 * q.j5; \
    s6 += q.j1 * q.j1, s7 += q.j1 * q.j2, s8 += q.j1 * q.j3, s9 += q.j1 * q.j4, s10 += q.j1 * q.j5;                   \
    s11 += q.j2 * q.j2, s12 += q.j2 * q.j3, s13 += q.j2 * q.j4, s14 += q.j2 * q.j5;                                   \
    s15 += q.j3 * q.j3, s16 += q.j3 * q.j4, s17 += q.j3 * q.j5;                                                       \
    s18 += q.j4 * q.j4, s19 += q.j4 * q.j5;                                                                           \
    s20 += q.j5 * q.j5;                                                                                                \
    s21 += q.j0 * q.error, s22 += q.j1 * q.error, s23 += q.j2 * q.error;                                              \
    s24 += q.j3 * q.error, s25 += q.j4 * q.error, s26 += q.j5 * q.error;

#define ACCUMULATE(q)                                                                                                  \
    ACCUMULATE_ROW(q)                                                                                                  \
    s27 += q.error * q.error, s28 += q.weight;

// Multiplies the first 27 sums: all rows so far count by that factor.
#define SCALE_ROWS(factor)                                                                                             \
    s0 *= factor, s1 *= factor, s2 *= factor, s3 *= factor, s4 *= factor, s5 *= factor, s6 *= factor, s7 *= factor;   \
    s8 *= factor, s9 *= factor, s10 *= factor, s11 *= factor, s12 *= factor, s13 *= factor, s14 *= factor;            \
    s15 *= factor, s16 *= factor, s17 *= factor, s18 *= factor, s19 *= factor, s20 *= factor, s21 *= factor;          \
    s22 *= factor, s23 *= factor, s24 *= factor, s25 *= factor, s26 *= factor;

#define COLLECT(sums)                                                                                                  \
    sums[0] = s0, sums[1] = s1, sums[2] = s2, sums[3] = s3, sums[4] = s4, sums[5] = s5, sums[6] = s6, sums[7] = s7;   \
    sums[8] = s8, sums[9] = s9, sums[10] = s10, sums[11] = s11, sums[12] = s12, sums[13] = s13, sums[14] = s14;       \
    sums[15] = s15, sums[16] = s16, sums[17] = s17, sums[18] = s18, sums[19] = s19, sums[20] = s20, sums[21] = s21;   \
    sums[22] = s22, sums[23] = s23, sums[24] = s24, sums[25] = s25, sums[26] = s26, sums[27] = s27, sums[28] = s28;   \
    sums[29] = s29, sums[30] = s30;

// Leaves the sums behind as one record of SUMS floats per work-group, from the top level of a kernel.
// Rows: a work-group is one work-item. Pixels: the work-items of a group add up their sums in local memory, always in
// the same order.
#ifdef PIXELS
#define LEAVE_RECORD(records)                                                                                          \
    float sums[SUMS];                                                                                                  \
    COLLECT(sums)                                                                                                      \
    local float lane[SUM_GROUP];                                                                                       \
    const int me = get_local_id(0);                                                                                    \
    for (int k = 0; k < SUMS - 1; ++k) {                                                                               \
        lane[me] = sums[k];                                                                                            \
        for (int stride = SUM_GROUP / 2; stride > 0; stride /= 2) {                                                    \
            barrier(CLK_LOCAL_MEM_FENCE);                                                                              \
            if (me < stride)                                                                                           \
                lane[me] += lane[me + stride];                                                                         \
        }                                                                                                              \
        if (me == 0)                                                                                                   \
            records[get_group_id(0) * SUMS + k] = lane[0];                                                             \
        barrier(CLK_LOCAL_MEM_FENCE);                                                                                  \
    }
#define SUM_GROUP_SIZE __attribute__((reqd_work_group_size(SUM_GROUP, 1, 1)))
#else
#define LEAVE_RECORD(records)                                                                                          \
    global float *restrict record = records + get_group_id(0) * SUMS;                                                  \
    COLLECT(record)
#define SUM_GROUP_SIZE
#endif

// The work-items' share of an image: by rows each walks its own, by pixels they take them in turn.
#ifdef PIXELS
#define EACH_SUMMED(i, x, y, width, height)                                                                            \
    for (int i = get_global_id(0), x, y; y = i / (width), x = i - y * (width), i < (width) * (height);                 \
         i += get_global_size(0))
#else
#define EACH_SUMMED(i, x, y, width, height)                                                                            \
    const int y = get_global_id(0);                                                                                    \
    for (int x = 0, i = y * (width); x < (width); ++x, ++i)
#endif
