// Elementary functions without branches and tables, so that a loop over lanes becomes vector instructions.
#pragma once

#include <stdint.h>
#include <string.h>
#include <tgmath.h>

// In float, constants are made single by a flag of the compiler: -fsingle-precision-constant.
#ifdef SINGLE
typedef float real;
typedef int32_t whole;
// Adding this moves a whole number into the low bits of a number.
#define TO_LOW_BITS 0x1.8p23f
#define MANTISSA 23
#define BIAS 127
#define LEAST_EXPONENT -87.0f
#else
typedef double real;
typedef int64_t whole;
#define TO_LOW_BITS 0x1.8p52
#define MANTISSA 52
#define BIAS 1023
#define LEAST_EXPONENT -700.0
#endif

// x + change. In float what the sum loses is kept in `lost` and added to the next (Kahan), as ours does.
static inline real sum_of(real x, real change, real *lost) {
#ifdef SINGLE
    change += *lost;
    const real sum = x + change;
    *lost = change - (sum - x);
    return sum;
#else
    (void)lost;
    return x + change;
#endif
}

static inline whole bits_of(real x) {
    whole bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline real real_of(whole bits) {
    real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

// e^x for x <= 700 (float: 88) to 2 units in the last place; below the least exponent it is that of the least: no
// subnormal number arises.
static inline real fast_exp(real x) {
    x = x > LEAST_EXPONENT ? x : LEAST_EXPONENT;
    const real n = rint(x * (real)0x1.71547652b82fep+0);
    // Taylor: the first term left out is r^13 / 13! < 2e-16 for |r| < ln(2) / 2; in float r^8 / 8! < 6e-9.
#ifdef SINGLE
    const real r = (x - n * 0x1.62e4p-1f) - n * 0x1.7f7d1cp-20f;
    const real r2 = r * r, r4 = r2 * r2;
    const real p01 = 1.0 + r, p23 = 1.0 / 2 + r * (1.0 / 6), p45 = 1.0 / 24 + r * (1.0 / 120);
    const real p67 = 1.0 / 720 + r * (1.0 / 5040);
    const real p = p01 + r2 * p23 + r4 * (p45 + r2 * p67);
#else
    const real r = (x - n * 0x1.62e42fefa0000p-1) - n * 0x1.cf79abc9e3b3ap-40;
    const real r2 = r * r, r4 = r2 * r2, r8 = r4 * r4;
    const real p01 = 1.0 + r, p23 = 1.0 / 2 + r * (1.0 / 6), p45 = 1.0 / 24 + r * (1.0 / 120);
    const real p67 = 1.0 / 720 + r * (1.0 / 5040), p89 = 1.0 / 40320 + r * (1.0 / 362880);
    const real pab = 1.0 / 3628800 + r * (1.0 / 39916800);
    const real p03 = p01 + r2 * p23, p47 = p45 + r2 * p67, p8c = p89 + r2 * pab + r4 * (1.0 / 479001600);
    const real p = p03 + r4 * p47 + r8 * p8c;
#endif
    return p * real_of((whole)((bits_of(n + (real)TO_LOW_BITS) + BIAS) << MANTISSA));
}

// sin(x) and cos(x) for 0 <= x < 1e5 to 1e-15; in float for x < 1e3 to 1e-7.
static inline void fast_sin_cos(real x, real *sine, real *cosine) {
    const real n = rint(x * (real)0x1.45f306dc9c883p-1);
#ifdef SINGLE
    const real r = ((x - n * 1.5703125f) - n * 4.837512969970703e-4f) - n * 7.549789948768648e-8f;
    const real r2 = r * r;
    const real s = r + r * r2 * (-1.0 / 6 + r2 * (1.0 / 120 + r2 * (-1.0 / 5040 + r2 * (1.0 / 362880))));
    const real c = 1.0 + r2 * (-1.0 / 2 + r2 * (1.0 / 24 + r2 * (-1.0 / 720 + r2 * (1.0 / 40320))));
#else
    const real r = ((x - n * 0x1.921fb54400000p+0) - n * 0x1.0b4611a600000p-34) - n * 0x1.3198a2e037073p-69;
    const real r2 = r * r;
    const real s = r + r * r2 * (-1.0 / 6 + r2 * (1.0 / 120 + r2 * (-1.0 / 5040 + r2 * (1.0 / 362880
                 + r2 * (-1.0 / 39916800 + r2 * (1.0 / 6227020800.0 - r2 * (1.0 / 1307674368000.0)))))));
    const real c = 1.0 + r2 * (-1.0 / 2 + r2 * (1.0 / 24 + r2 * (-1.0 / 720 + r2 * (1.0 / 40320
                 + r2 * (-1.0 / 3628800 + r2 * (1.0 / 479001600.0 - r2 * (1.0 / 87178291200.0)))))));
#endif
    const whole quadrant = bits_of(n + (real)TO_LOW_BITS);
    const int odd = quadrant & 1;
    const real first = odd ? c : s, second = odd ? s : c;
    *sine = (quadrant & 2) ? -first : first;
    *cosine = ((quadrant + 1) & 2) ? -second : second;
}
