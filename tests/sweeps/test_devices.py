"""One device or several: the same bits."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_bits_do_not_depend_on_the_number_of_devices():
    """In processes of their own: JAX counts the devices once. With effects, a cut-off and courses."""
    program = """
import hashlib, json, os, sys
os.sched_getaffinity = lambda _: set(range(int(sys.argv[1])))
import jax, numpy as np, sweeps
study = sweeps.Study(
    kind="robot",
    parameters={"capacity_Ah": 0.5},
    effects={"self_heating": {}, "viscous_friction": {}},
    profile={"duration_s": 120, "step_s": 10, "ambient_degC": 20.0},
    axes={"load_torque_Nm": np.linspace(0.0, 0.35, 12), "duty": np.linspace(0.1, 0.5, 12)},
    metrics=[*sweeps.metrics_of("robot"), *sweeps.metrics_on_request("robot")],
    store=["soc"], store_every=4, cutoff={"soc": 0.95},
)
result = sweeps.run(study)
bits = {name: hashlib.sha256(values.values.tobytes()).hexdigest() for name, values in result.data_vars.items()}
print(json.dumps([jax.device_count(), json.loads(result.attrs["manifest"])["performance"]["devices"], bits]))
"""

    def started(cores: int) -> subprocess.Popen:
        command = [sys.executable, "-c", program, str(cores)]
        return subprocess.Popen(command, cwd=Path(__file__).parents[2], stdout=subprocess.PIPE, text=True)

    runs = [started(cores) for cores in (1, 2)]
    answers = [json.loads(run.communicate(timeout=120)[0]) for run in runs]
    assert [count for count, _, _ in answers] == [1, 2]
    assert [devices[:4] for _, devices, _ in answers] == ["1 x ", "2 x "]
    assert len(answers[0][2]) == 24
    assert answers[0][2] == answers[1][2]
