// Lanes of a robot at constant duty: the exponential midpoint step of jaxmodel.model.step, with the armature and rotor
// of each half and whole step solved exactly as a linear pair with dry friction (jaxmodel.armature).
#include <omp.h>

#include "cell.h"

#define WIDTH 128

typedef struct {
    CellParameters cell;
    real n_series, n_motors, duty, onboard_A;
    real R_0, psi_R, T_0, k_tau, L_a, J, tau_0, R_wc, R_ca, tau_wc, tau_ca;
} RobotParameters;

// What the slow state says of the pack and the armature: V_pack = pack_V - pack_ohm i_pack.
typedef struct {
    real pack_V, pack_ohm, winding_ohm;
} Slow;

static inline Slow slow_parts(real soc, real v_short, real v_long, real x_winding, real x_case, real ageing,
                              const RobotParameters *p) {
    const real ocv = open_circuit_voltage(soc, &p->cell), series = series_resistance(soc, ageing, &p->cell);
    const real above = p->cell.ambient_degC + x_case + x_winding - p->T_0;
    return (Slow){p->n_series * (ocv - v_short - v_long), p->n_series * series, p->R_0 * (1.0 + p->psi_R * above)};
}

// di/dt and dw/dt without Coulomb friction: affine in (i, w).
typedef struct {
    real current, speed;
} Pair;

static inline Pair rates(const Slow *s, real i, real w, real load, const RobotParameters *p) {
    const real pack_A = p->n_motors * p->duty * i + p->onboard_A;
    const real across = p->duty * (s->pack_V - s->pack_ohm * pack_A) - s->winding_ohm * i - p->k_tau * w;
    return (Pair){across * (1.0 / p->L_a), (p->k_tau * i - load) * (1.0 / p->J)};
}

typedef struct {
    real current, speed, mean_current, mean_speed, variance, friction;
} Armature;

// One span of the pair; `now` at its start, `later` for its coefficients, `per_lead` one over the time between them.
static inline Armature armature(real i, real w, const Slow *now, const Slow *later, real per_lead, real h, real per_h,
                                real load, const RobotParameters *p) {
    const Pair rate = rates(now, i, w, load, p), there = rates(later, i, w, load, p);
    const real drift_i = (there.current - rate.current) * per_lead, drift_w = (there.speed - rate.speed) * per_lead;
    const real a = -(later->winding_ohm + p->duty * later->pack_ohm * p->n_motors * p->duty) * (1.0 / p->L_a);
    const real b = -p->k_tau / p->L_a, c = p->k_tau / p->J;  // d = 0: friction is Coulomb's alone
    const real determinant = -b * c, per_determinant = 1.0 / determinant;
    // The inverse [[0, 1/c], [1/b, -a/(b c)]] of [[a, b], [c, 0]].
    const real inv_b = -b * per_determinant, inv_c = -c * per_determinant, inv_d = a * per_determinant;

    // exp(A h), over- and underdamped, smooth between.
    const real mean = 0.5 * a, discriminant = mean * mean - determinant, scaled = discriminant * h * h;
    const real size = discriminant > 0.0 ? discriminant : -discriminant;
    const int over = discriminant > 0.0, series = (scaled > 0.0 ? scaled : -scaled) < 1e-2;
    const real root = sqrt(series ? 1.0 : size), fast = mean - root;
    const real slow = over ? determinant / fast : mean;
    const real e_slow = fast_exp(slow * h), e_fast = fast_exp((over ? fast : mean) * h);
    real sine, cosine;
    fast_sin_cos(over ? 0.0 : root * h, &sine, &cosine);
    const real even_series = 1.0 + scaled / 2 * (1.0 + scaled / 12 * (1.0 + scaled / 30 * (1.0 + scaled / 56)));
    const real odd_series = 1.0 + scaled / 6 * (1.0 + scaled / 20 * (1.0 + scaled / 42 * (1.0 + scaled / 72)));
    const real e_mean = fast_exp(mean * h);
    const real over_even = 0.5 * (e_slow + e_fast), over_odd = 0.5 * (e_slow - e_fast);
    const real under_even = e_mean * cosine, under_odd = e_mean * sine;
    real even = over ? over_even : under_even, odd = (over ? over_odd : under_odd) / root;
    even = series ? e_mean * even_series : even;
    odd = series ? e_mean * h * odd_series : odd;
    const real shift = even - odd * mean;
    const real e_a = odd * a + shift, e_b = odd * b, e_c = odd * c, e_d = shift;

    const real creep_i = -inv_b * drift_w, creep_w = -(inv_c * drift_i + inv_d * drift_w);
    real centre_i = i - inv_b * rate.speed + inv_b * creep_w;
    real centre_w = w - (inv_c * rate.current + inv_d * rate.speed) + inv_c * creep_i + inv_d * creep_w;
    const real torque_i = inv_b * (1.0 / p->J), torque_w = inv_d * (1.0 / p->J);
    const real free_w = centre_w + creep_w * h + e_c * (i - centre_i) + e_d * (w - centre_w);
    const real response = -(torque_w - e_c * torque_i - e_d * torque_w);
    const real sign = w > 0.0 ? 1.0 : w < 0.0 ? -1.0 : 0.0;
    const real stopping = response > 0.0 ? free_w / (response > 0.0 ? response : 1.0) : sign * p->tau_0;
    const real capped = stopping < p->tau_0 ? stopping : p->tau_0, friction = capped > -p->tau_0 ? capped : -p->tau_0;

    centre_i += torque_i * friction;
    centre_w += torque_w * friction;
    const real from_i = i - centre_i, from_w = w - centre_w;
    const real to_i = e_a * from_i + e_b * from_w, to_w = e_c * from_i + e_d * from_w;
    const real away_i = inv_b * (to_w - from_w) * per_h;
    const real away_w = (inv_c * (to_i - from_i) + inv_d * (to_w - from_w)) * per_h;
    const real currents = from_i * from_i - to_i * to_i, speeds = from_w * from_w - to_w * to_w;
    const real square = -(determinant * currents + b * b * speeds) / (2.0 * a * determinant);
    return (Armature){centre_i + creep_i * h + to_i, centre_w + creep_w * h + to_w,
                      centre_i + 0.5 * h * creep_i + away_i, centre_w + 0.5 * h * creep_w + away_w,
                      square * per_h - away_i * away_i, friction};
}

static inline real motor_loss(const Armature *m, const Slow *s) {
    return (m->mean_current * m->mean_current + m->variance) * s->winding_ohm + m->friction * m->mean_speed;
}

// For each lane its load torque (N m) and resistance of ageing (ohm); out come final SOC and least pack voltage at the
// rows. `ends_row` marks the steps that end at one.
void run_robots(const RobotParameters *p, long lanes, const real *load_Nm, const real *cycle_ohm, long steps,
                const real *duration_s, const char *ends_row, real *final_soc, real *least_voltage) {
#pragma omp parallel for schedule(static)
    for (long first = 0; first < lanes; first += WIDTH) {
        const int count = lanes - first < WIDTH ? (int)(lanes - first) : WIDTH;
        const real *load = load_Nm + first, *ageing = cycle_ohm + first;
        const real per_charge = 1.0 / (3600.0 * p->cell.capacity_Ah * p->cell.storage_factor);
        const real ratio = p->n_motors * p->duty;
        real soc[WIDTH], lost[WIDTH] = {0}, v_short[WIDTH], v_long[WIDTH], x_winding[WIDTH], x_case[WIDTH], i_a[WIDTH], speed[WIDTH];
        real pack_V[WIDTH], pack_ohm[WIDTH], winding_ohm[WIDTH], least[WIDTH];  // the first three at the present state
        for (int l = 0; l < count; l++) {
            soc[l] = p->cell.initial_soc;
            v_short[l] = v_long[l] = x_winding[l] = x_case[l] = i_a[l] = speed[l] = 0.0;
            const Slow s = slow_parts(soc[l], 0.0, 0.0, 0.0, 0.0, ageing[l], p);
            pack_V[l] = s.pack_V, pack_ohm[l] = s.pack_ohm, winding_ohm[l] = s.winding_ohm;
            least[l] = s.pack_V - s.pack_ohm * p->onboard_A;
        }
        for (long k = 0; k < steps; k++) {
            const real h = duration_s[k], half = 0.5 * h, per_h = 1.0 / h, per_half = 1.0 / half;
            const real keep_wc = 1.0 - exp(-half / p->tau_wc), keep_ca = 1.0 - exp(-half / p->tau_ca);
            const real whole_wc = 1.0 - exp(-h / p->tau_wc), whole_ca = 1.0 - exp(-h / p->tau_ca);
            const int row = ends_row[k];
#pragma omp simd
            for (int l = 0; l < count; l++) {
                // To the middle with the coefficients of the start.
                const Slow here = {pack_V[l], pack_ohm[l], winding_ohm[l]};
                const Pairs rc = rc_pairs(soc[l], &p->cell);
                const Armature begin = armature(i_a[l], speed[l], &here, &here, 0.0, half, per_half, load[l], p);
                const real pack_A = ratio * begin.mean_current + p->onboard_A;
                const real heat = motor_loss(&begin, &here);
                const real mid_soc = soc[l] - pack_A * per_charge * half;
                const real mid_short = relaxed(v_short[l], pack_A * rc.short_ohm, half, rc.short_s);
                const real mid_long = relaxed(v_long[l], pack_A * rc.long_ohm, half, rc.long_s);
                const real mid_winding = x_winding[l] + (p->R_wc * heat - x_winding[l]) * keep_wc;
                const real mid_case = x_case[l] + (p->R_ca * heat - x_case[l]) * keep_ca;
                // The whole step with those of the middle.
                const Slow there = slow_parts(mid_soc, mid_short, mid_long, mid_winding, mid_case, ageing[l], p);
                const Pairs mid_rc = rc_pairs(mid_soc, &p->cell);
                const Armature step = armature(i_a[l], speed[l], &here, &there, per_half, h, per_h, load[l], p);
                const real drawn = ratio * step.mean_current + p->onboard_A;
                const real loss = motor_loss(&step, &there);
                soc[l] = sum_of(soc[l], -drawn * per_charge * h, &lost[l]);
                v_short[l] = relaxed(v_short[l], drawn * mid_rc.short_ohm, h, mid_rc.short_s);
                v_long[l] = relaxed(v_long[l], drawn * mid_rc.long_ohm, h, mid_rc.long_s);
                x_winding[l] += (p->R_wc * loss - x_winding[l]) * whole_wc;
                x_case[l] += (p->R_ca * loss - x_case[l]) * whole_ca;
                i_a[l] = step.current;
                speed[l] = step.speed;
                // The voltage at the end, and the coefficients at the start of the next step.
                const Slow end = slow_parts(soc[l], v_short[l], v_long[l], x_winding[l], x_case[l], ageing[l], p);
                pack_V[l] = end.pack_V, pack_ohm[l] = end.pack_ohm, winding_ohm[l] = end.winding_ohm;
                const real voltage = end.pack_V - end.pack_ohm * (ratio * i_a[l] + p->onboard_A);
                least[l] = row && voltage < least[l] ? voltage : least[l];
            }
        }
        memcpy(final_soc + first, soc, count * sizeof(real));
        memcpy(least_voltage + first, least, count * sizeof(real));
    }
}
