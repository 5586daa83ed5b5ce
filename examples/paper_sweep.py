"""The study of paper_sweep.toml, written in Python."""

import numpy as np

from jaxmodel import sweeps

study = sweeps.Study(
    title="The paper's robot: 4,536 discharges",
    kind="robot",
    parameters={"onboard_current_A": 0.3},
    profile={"duration_s": 1800, "step_s": 1, "duty": 0.3},
    axes={
        "ambient_degC": np.linspace(-20, 100, 7),
        "load_torque_Nm": [0.0, 0.05, 0.1, 0.175, 0.2, 0.25, 0.3, 0.35],
        "storage_months": np.linspace(0, 36, 9),
        "cycles": np.linspace(0, 400, 9),
    },
    metrics=[
        "soc_gradient",
        "final_soc",
        "delivered_charge_Ah",
        "delivered_energy_Wh",
        "min_pack_voltage_V",
        "peak_winding_temperature_degC",
        "peak_case_temperature_degC",
        "mean_speed_rad_s",
        "valid_share",
    ],
)

if __name__ == "__main__":
    sweeps.save(sweeps.run(study), "paper-sweep")
