// Lanes of a cell at constant current: the exponential midpoint step of jaxmodel.model.step.
#include <omp.h>

#include "cell.h"

#define WIDTH 128

// For each lane its current (A) and resistance of ageing (ohm); out come final SOC and least voltage at the rows.
void run_cells(const CellParameters *p, long lanes, const real *current_A, const real *cycle_ohm, long steps,
               const real *duration_s, real *final_soc, real *least_voltage) {
#pragma omp parallel for schedule(static)
    for (long first = 0; first < lanes; first += WIDTH) {
        const int count = lanes - first < WIDTH ? (int)(lanes - first) : WIDTH;
        const real *current = current_A + first, *ageing = cycle_ohm + first;
        const real per_charge = 1.0 / (3600.0 * p->capacity_Ah * p->storage_factor);
        real soc[WIDTH], v_short[WIDTH], v_long[WIDTH], least[WIDTH], lost[WIDTH] = {0};
        for (int l = 0; l < count; l++) {
            soc[l] = p->initial_soc;
            v_short[l] = v_long[l] = 0.0;
            least[l] = open_circuit_voltage(soc[l], p) - current[l] * series_resistance(soc[l], ageing[l], p);
        }
        for (long k = 0; k < steps; k++) {
            const real h = duration_s[k];
#pragma omp simd
            for (int l = 0; l < count; l++) {
                const real i = current[l], drained = i * per_charge * h;
                const Pairs pairs = rc_pairs(soc[l] - 0.5 * drained, p);
                const real end = sum_of(soc[l], -drained, &lost[l]);
                v_short[l] = relaxed(v_short[l], i * pairs.short_ohm, h, pairs.short_s);
                v_long[l] = relaxed(v_long[l], i * pairs.long_ohm, h, pairs.long_s);
                const real voltage = open_circuit_voltage(end, p) - i * series_resistance(end, ageing[l], p) - v_short[l] - v_long[l];
                least[l] = voltage < least[l] ? voltage : least[l];
                soc[l] = end;
            }
        }
        memcpy(final_soc + first, soc, count * sizeof(real));
        memcpy(least_voltage + first, least, count * sizeof(real));
    }
}
