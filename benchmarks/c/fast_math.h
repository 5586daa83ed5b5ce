// Elementary functions without branches and tables, so that a loop over lanes becomes vector instructions.
#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef double real;

// Adding this moves a whole number into the low bits of a double.
#define TO_LOW_BITS 0x1.8p52

static inline int64_t bits_of(real x) {
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline real real_of(int64_t bits) {
    real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

// e^x for x <= 700 to 2 units in the last place; below -700 it is e^-700: no subnormal number arises.
static inline real fast_exp(real x) {
    x = x > -700.0 ? x : -700.0;
    const real n = rint(x * 0x1.71547652b82fep+0);
    const real r = (x - n * 0x1.62e42fefa0000p-1) - n * 0x1.cf79abc9e3b3ap-40;
    // Taylor: the first term left out is r^13 / 13! < 2e-16 for |r| < ln(2) / 2.
    const real r2 = r * r, r4 = r2 * r2, r8 = r4 * r4;
    const real p01 = 1.0 + r, p23 = 1.0 / 2 + r * (1.0 / 6), p45 = 1.0 / 24 + r * (1.0 / 120);
    const real p67 = 1.0 / 720 + r * (1.0 / 5040), p89 = 1.0 / 40320 + r * (1.0 / 362880);
    const real pab = 1.0 / 3628800 + r * (1.0 / 39916800);
    const real p03 = p01 + r2 * p23, p47 = p45 + r2 * p67, p8c = p89 + r2 * pab + r4 * (1.0 / 479001600);
    const real p = p03 + r4 * p47 + r8 * p8c;
    return p * real_of((bits_of(n + TO_LOW_BITS) + 1023) << 52);
}

// sin(x) and cos(x) for 0 <= x < 1e5 to 1e-15.
static inline void fast_sin_cos(real x, real *sine, real *cosine) {
    const real n = rint(x * 0x1.45f306dc9c883p-1);
    const real r = ((x - n * 0x1.921fb54400000p+0) - n * 0x1.0b4611a600000p-34) - n * 0x1.3198a2e037073p-69;
    const real r2 = r * r;
    const real s = r + r * r2 * (-1.0 / 6 + r2 * (1.0 / 120 + r2 * (-1.0 / 5040 + r2 * (1.0 / 362880
                 + r2 * (-1.0 / 39916800 + r2 * (1.0 / 6227020800.0 - r2 * (1.0 / 1307674368000.0)))))));
    const real c = 1.0 + r2 * (-1.0 / 2 + r2 * (1.0 / 24 + r2 * (-1.0 / 720 + r2 * (1.0 / 40320
                 + r2 * (-1.0 / 3628800 + r2 * (1.0 / 479001600.0 - r2 * (1.0 / 87178291200.0)))))));
    const int64_t quadrant = bits_of(n + TO_LOW_BITS);
    const int odd = quadrant & 1;
    const real first = odd ? c : s, second = odd ? s : c;
    *sine = (quadrant & 2) ? -first : first;
    *cosine = ((quadrant + 1) & 2) ? -second : second;
}
