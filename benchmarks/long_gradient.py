"""A gradient by all parameters through 100,000 steps, alone in its process: prints the peak of its memory in KiB.

Run by itself (`python -m benchmarks.long_gradient`), so that nothing else is in the figure but JAX. It prints the
elasticity of the energy by the current too, which is near 1.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.sensitivity.derivatives import local_sensitivities

STEPS = 100_000


def main() -> None:
    """Differentiate the energy of a cell under a load that never repeats itself."""
    rows = np.arange(float(STEPS + 1))
    profile = Profile(rows, {"current_A": 0.05 + 0.02 * np.sin(rows / 50.0), "ambient_degC": np.full(rows.size, 20.0)})
    data = local_sensitivities(Model("cell"), profile, metrics=("delivered_energy_Wh",), outputs=(), mode="reverse")
    if not np.all(np.isfinite(data["metric_derivative"])):
        raise FloatingPointError(f"derivatives are not finite: {data['metric_derivative'].values}")
    # VmHWM, not ru_maxrss: the latter is that of the process which forked this one, if that was larger.
    status = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    peak = next(line.split()[1] for line in status if line.startswith("VmHWM"))
    print(peak, float(data["elasticity"].sel(parameter="current_A").item()))


if __name__ == "__main__":
    main()
