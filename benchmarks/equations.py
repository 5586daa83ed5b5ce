"""One cell in continuous time, eqs. 1 to 10 of docs/model.md, for solvers other than ours; NumPy or JAX as `np`."""

from __future__ import annotations

from typing import Any

SOC_FLOOR = 0.012


def elements(np: Any, soc: Any) -> tuple[Any, Any, Any, Any]:
    """Return R_TS, C_TS, R_TL, C_TL in ohm and F."""
    held = np.maximum(soc, SOC_FLOOR)
    return (
        0.3208 * np.exp(-29.14 * held) + 0.04669,
        -752.9 * np.exp(-13.51 * held) + 703.6,
        6.603 * np.exp(-155.2 * held) + 0.04984,
        -6056.0 * np.exp(-27.12 * held) + 4475.0,
    )


def series_resistance(np: Any, soc: Any, cycles: Any, ambient_degC: float) -> Any:
    """Return R_ints + R_cyc in ohm."""
    at_temperature = ambient_degC * (-2.768e-4 - 1.399e-5 * ambient_degC)
    return at_temperature + 0.1562 * np.exp(-24.37 * np.maximum(soc, SOC_FLOOR)) + 0.07446 + 0.0015 * cycles**0.5


def open_circuit_voltage(np: Any, soc: Any) -> Any:
    """Return V_oc in V."""
    return -1.031 * np.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201))


def rates(np: Any, soc: Any, short_V: Any, long_V: Any, current_A: Any, charge_C: float) -> tuple[Any, Any, Any]:
    """Return d(SOC)/dt, dV_TS/dt and dV_TL/dt."""
    r_s, c_s, r_l, c_l = elements(np, soc)
    return -current_A / charge_C, (current_A - short_V / r_s) / c_s, (current_A - long_V / r_l) / c_l


def voltage(np: Any, soc: Any, short_V: Any, long_V: Any, current_A: Any, cycles: Any, ambient_degC: float) -> Any:
    """Return the terminal voltage in V."""
    series = series_resistance(np, soc, cycles, ambient_degC)
    return open_circuit_voltage(np, soc) - current_A * series - short_V - long_V
