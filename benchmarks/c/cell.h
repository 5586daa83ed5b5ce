// One lithium cell: eqs. 1 to 10 of docs/model.md.
#pragma once

#include "fast_math.h"

// What all lanes share.
typedef struct {
    real capacity_Ah, initial_soc, storage_factor, ambient_degC;
    real series_scale, rc_scale, capacitance_scale, ocv_offset_V;
} CellParameters;

// The formulas of eqs. 3-6 and 10 are held below this state of charge.
#define SOC_FLOOR 0.012

static inline real open_circuit_voltage(real soc, const CellParameters *p) {
    return -1.031 * fast_exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201)) + p->ocv_offset_V;
}

static inline real series_resistance(real soc, real cycle_ohm, const CellParameters *p) {
    const real held = soc > SOC_FLOOR ? soc : SOC_FLOOR, t = p->ambient_degC;
    const real at_temperature = t * (-2.768e-4 - 1.399e-5 * t) + 0.1562 * fast_exp(-24.37 * held) + 0.07446;
    return (at_temperature + cycle_ohm) * p->series_scale;
}

// R (ohm) and time constant R C (s) of the short and the long RC pair.
typedef struct {
    real short_ohm, short_s, long_ohm, long_s;
} Pairs;

static inline Pairs rc_pairs(real soc, const CellParameters *p) {
    const real held = soc > SOC_FLOOR ? soc : SOC_FLOOR;
    const real r_s = (0.3208 * fast_exp(-29.14 * held) + 0.04669) * p->rc_scale;
    const real c_s = (-752.9 * fast_exp(-13.51 * held) + 703.6) * p->capacitance_scale;
    const real r_l = (6.603 * fast_exp(-155.2 * held) + 0.04984) * p->rc_scale;
    const real c_l = (-6056.0 * fast_exp(-27.12 * held) + 4475.0) * p->capacitance_scale;
    return (Pairs){r_s, r_s * c_s, r_l, r_l * c_l};
}

// A relaxation towards `target` with a time constant, after `duration`: exact.
static inline real relaxed(real now, real target, real duration, real time_constant) {
    return target + (now - target) * fast_exp(-duration / time_constant);
}
