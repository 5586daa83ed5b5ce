"""Write the paper's Table 1 as seven measured runs: the state of charge after half an hour at each temperature.

The table prints a slope in steps of 0.1e-4 per s, and nothing else of its seven runs. So a run has one reading, the
state of charge at its end; its sd is that of the rounding of the slope, 0.1e-4 / sqrt(12) * 1800 s.
"""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent
SLOPES = {-20: -2.8e-4, 0: -2.5e-4, 20: -2.1e-4, 40: -1.6e-4, 60: -1.3e-4, 80: -0.9e-4, 100: -0.5e-4}
DURATION_S, STEP_S = 1800, 60
HELD_OUT = 40  # degC: the inner run, used as check run
HEAD = """# Made by make_case.py; do not edit. Table 1 of Specht et al., p. 6, as a measurement.
# The paper states neither torque nor duty of these runs: 175 mNm and 0.3 give its slope at 20 degC.
title = "Table 1 of the paper as a measurement"
kind = "robot"
preset = "paper"

[parameters]                                      # sd: assumed; the paper states none
capacity_Ah = { value = 5.2, sd = 0.15 }
k_tau = { value = 0.0385, sd = 0.001 }
R_0 = { value = 0.103, sd = 0.003 }
tau_0 = { value = 0.01, sd = 0.002 }
onboard_current_A = { value = 0.3, sd = 0.1 }

[sensors]
soc = 0.0052                                      # rounding of the printed slope, over the run
"""


def main() -> None:
    """Write `case.toml` and a CSV for each temperature."""
    text = HEAD
    for ambient, slope in SLOPES.items():
        name = f"ambient{ambient:+04d}.csv"
        split = "check" if ambient == HELD_OUT else "fit"
        text += f'\n[[runs]]\nfile = "{name}"\nsplit = "{split}"\nlabel = "{ambient} degC"\n'
        text += "initial_soc = 1.0\n"
        rows = ["time_s,duty,load_torque_Nm,ambient_degC,soc"]
        for time in range(0, DURATION_S + 1, STEP_S):
            reading = f"{1.0 + slope * time:.4f}" if time == DURATION_S else ""
            rows.append(f"{time},0.3,0.175,{ambient},{reading}")
        (HERE / name).write_text("\n".join(rows) + "\n", encoding="utf-8")
    (HERE / "case.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
