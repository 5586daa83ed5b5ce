"""Write the paper's experiment (section 4, Tables 3 and 5) as a case: four tests without load, two readings each.

The voltmeter is good to 0.1 V: its sd is that of an even spread over +- 0.1 V. The measured 22.6 V is the rest of a
pack at a state of charge of 0.38 by the model's open-circuit voltage, of which the paper says nothing.
"""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent
# Name, ambient in degC, duty (15 % less motor current is 15 % less duty, eq. 14), first and last reading in V.
TESTS = (
    ("nc20", 20, 1.0, 22.6, 22.4),
    ("c20", 20, 0.85, 22.6, 22.4),
    ("nc30", 30, 1.0, 22.6, 22.5),
    ("c30", 30, 0.85, 22.6, 22.6),
)
DURATION_S, STEP_S = 1800, 60
HEAD = """# Made by make_case.py; do not edit. Section 4 of Specht et al., Tables 3 and 5.
title = "The paper's experiment: no load at 20 and 30 degC"
kind = "robot"
preset = "paper"

[parameters]                                      # sd: assumed; the paper states none
series_resistance_scale = { value = 1.0, sd = 0.5 }
rc_resistance_scale = { value = 1.0, sd = 0.5 }
tau_0 = { value = 0.01, sd = 0.003 }              # the paper saw 30 % less no-load current than its model has

[sensors]
pack_voltage_V = 0.058                            # +- 0.1 V, evenly
"""


def main() -> None:
    """Write `case.toml` and a CSV for each test."""
    text = HEAD
    for name, ambient, duty, first, last in TESTS:
        text += f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{"fit" if name != "c30" else "check"}"\n'
        text += f'label = "{name}"\ninitial_soc = {{ value = 0.38, sd = 0.1 }}\n'
        rows = ["time_s,duty,load_torque_Nm,ambient_degC,pack_voltage_V"]
        for time in range(0, DURATION_S + 1, STEP_S):
            reading = {0: f"{first}", DURATION_S: f"{last}"}.get(time, "")
            rows.append(f"{time},{duty},0,{ambient},{reading}")
        (HERE / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (HERE / "case.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
