"""The exponential midpoint step of a cell in numba, lanes spread over threads by `prange`."""

import math
import sys

import numba
import numpy as np
from serve import serve

FLOOR = 0.012


@numba.njit(parallel=True, fastmath=True, error_model="numpy")
def run_cells(current_A, cycles, steps, h, charge_C, ambient_degC, soc_out, volts_out):
    """Run all lanes."""
    at_temperature = ambient_degC * (-2.768e-4 - 1.399e-5 * ambient_degC)
    for lane in numba.prange(current_A.size):
        i = current_A[lane]
        drained = i / charge_C * h
        ageing = 0.0015 * math.sqrt(cycles[lane])
        soc, short_V, long_V, least, volts = 1.0, 0.0, 0.0, 1e9, 0.0
        for _ in range(steps):
            held = max(soc - 0.5 * drained, FLOOR)
            r_s = 0.3208 * math.exp(-29.14 * held) + 0.04669
            c_s = -752.9 * math.exp(-13.51 * held) + 703.6
            r_l = 6.603 * math.exp(-155.2 * held) + 0.04984
            c_l = -6056.0 * math.exp(-27.12 * held) + 4475.0
            soc -= drained
            short_V = i * r_s + (short_V - i * r_s) * math.exp(-h / (r_s * c_s))
            long_V = i * r_l + (long_V - i * r_l) * math.exp(-h / (r_l * c_l))
            series = at_temperature + 0.1562 * math.exp(-24.37 * max(soc, FLOOR)) + 0.07446 + ageing
            ocv = -1.031 * math.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201))
            volts = ocv - i * series - short_V - long_V
            least = min(least, volts)
        soc_out[lane], volts_out[lane] = soc, least


def prepare(job):
    """Return the run."""
    current, cycles = np.array(job["current_A"]), np.array(job["cycles"])
    soc, volts = np.empty(current.size), np.empty(current.size)
    steps = round(job["duration_s"] / job["step_s"])

    def run():
        run_cells(current, cycles, steps, job["step_s"], job["charge_C"], job["ambient_degC"], soc, volts)
        return soc, volts

    return run


if __name__ == "__main__":
    sys.exit(serve(prepare))
