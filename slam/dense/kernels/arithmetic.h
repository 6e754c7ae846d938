// Plain arithmetic in place of built-in functions inside inner loops: some OpenCL compilers for CPUs leave
// clamp(), fabs() and sqrt() as calls, and a loop with a call does not become vector code.
#define INLINE static inline __attribute__((always_inline))

INLINE int bounded(int value, int lowest, int highest)
{
    return value < lowest ? lowest : (value > highest ? highest : value);
}

INLINE float smaller(float a, float b)
{
    return a < b ? a : b;
}

INLINE float larger(float a, float b)
{
    return a > b ? a : b;
}

INLINE float magnitude(float a)
{
    return a < 0.0f ? -a : a;
}

// 1 / sqrt(a) for a > 0, to the precision of a float: an estimate from the exponent and three Newton steps.
INLINE float inverse_root(float a)
{
    const float half_a = 0.5f * a;
    float root = as_float(0x5f3759df - (as_int(a) >> 1));
    root = root * (1.5f - half_a * root * root);
    root = root * (1.5f - half_a * root * root);
    return root * (1.5f - half_a * root * root);
}
