// What OpenCL C takes for given and its compiler does not bring along for WebAssembly. Work-groups are of one work-item:
// its number is all that kernels of the rows layout ask for.
#define kernel static __attribute__((unused))

typedef unsigned char uchar;
typedef unsigned short ushort;
typedef unsigned int uint;
typedef float float3 __attribute__((ext_vector_type(3)));
typedef float float4 __attribute__((ext_vector_type(4)));

// Each thread keeps the work-item that it does at its own address, which the host chooses (launches.c).
#define ITEM ((global int *)(uint)__builtin_wasm_tls_base())
#define get_global_id(direction) (ITEM[direction])
#define get_group_id(direction) (ITEM[direction])
#define get_local_id(direction) 0
#define get_local_size(direction) 1

#define as_float(word) __builtin_astype((word), float)
#define as_int(number) __builtin_astype((number), int)
#define fabs(x) __builtin_elementwise_abs(x)
#define sqrt(x) __builtin_elementwise_sqrt(x)

// The Taylor polynomials of sine and cosine, to 1e-16 for |x| <= pi / 4.
static double near_sine(double x)
{
    const double s = x * x;
    return x * (1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110 * (1 - s / 156 * (1 - s / 210)))))));
}

static double near_cosine(double x)
{
    const double s = x * x;
    return 1 - s / 2 * (1 - s / 12 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90 * (1 - s / 132 * (1 - s / 182 * (1 - s / 240)))))));
}

// The sine of x + `quarters` quarters of a turn.
static double sine_after(double x, int quarters)
{
    const double turns = __builtin_elementwise_rint(x * 0.6366197723675814); // 2 / pi
    // pi / 2 as the sum of two doubles: the first has so few bits that its product with `turns` is exact.
    const double rest = (x - turns * 1.5707963267341256) - turns * 6.077100506506192e-11;
    const int quarter = ((int)turns + quarters) & 3;
    const double value = quarter & 1 ? near_cosine(rest) : near_sine(rest);
    return quarter & 2 ? -value : value;
}

static double sin(double x)
{
    return sine_after(x, 0);
}

static double cos(double x)
{
    return sine_after(x, 1);
}

// Half of an angle has the tangent t / (1 + sqrt(1 + t^2)).
static double half_tangent(double t)
{
    return t / (1 + __builtin_elementwise_sqrt(1 + t * t));
}

// The angle of (x, y) to the x axis, for y >= 0, to 1e-15.
static double atan2(double y, double x)
{
    if (!(y > 0))
        return x < 0 ? 3.141592653589793 : 0 * y;
    // The tangent of half the angle lies between 0 and infinity; of an eighth of it below .42.
    const double length = __builtin_elementwise_sqrt(x * x + y * y);
    const double part = x > 0 ? y / (length + x) : (length - x) / y;
    const double t = half_tangent(half_tangent(part)), u = half_tangent(t), s = u * u;
    double sum = 0;
    for (int k = 23; k > 0; k -= 2)
        sum = 1.0 / k - s * sum;
    return 16 * u * sum;
}
