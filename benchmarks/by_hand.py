"""The sweep written by hand in C (benchmarks/c): compiled at run time with this machine's compiler, called in place."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import jax
import numpy as np

from benchmarks.work import AMBIENT_DEGC, DUTY, Ours
from jaxmodel.model.cell import cycle_resistance, storage_factor

FLAGS = ("-std=c11", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC")
# As in jaxmodel.sweeps.devices; only some processors have vectors that wide, and only some compilers know the flag.
WIDE = "-mprefer-vector-width=512"
# Sums in float are compensated, which associative mathematics would take away as unneeded.
SINGLE = ("-DSINGLE", "-fsingle-precision-constant", "-fno-associative-math")
_SOURCES = Path(__file__).with_name("c")
_CELL = ("series_resistance_scale", "rc_resistance_scale", "rc_capacitance_scale", "ocv_offset_V")
_MOTOR = ("R_0", "psi_R", "T_0", "k_tau", "L_a", "J", "tau_0", "R_wc", "R_ca", "tau_wc", "tau_ca")


class NoCompiler(Exception):
    """The machine has no C compiler that can build the sources."""


@functools.cache
def library(kind: str, single: bool) -> ctypes.CDLL:
    """Compile the source of a kind, in float or double, and load it.

    Linked without -ffast-math, which would set the whole process to flush subnormal numbers.

    Raises:
        NoCompiler: there is none, or it refuses.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise NoCompiler("no C compiler (cc) on this machine")
    with tempfile.TemporaryDirectory() as folder:
        compiled, linked = f"{folder}/lanes.o", f"{folder}/lanes.so"
        source = str(_SOURCES / f"{kind}.c")
        for wide in ((WIDE,), ()):
            built = subprocess.run(
                [compiler, *FLAGS, *(SINGLE if single else ()), *wide, "-c", source, "-o", compiled],
                capture_output=True,
            )
            if built.returncode == 0:
                break
        linking = [compiler, "-shared", "-fopenmp", compiled, "-o", linked, "-lm"]
        if built.returncode or subprocess.run(linking, capture_output=True).returncode:
            raise NoCompiler(f"{compiler} cannot build {kind}.c with OpenMP")
        return ctypes.CDLL(linked)


class ByHand:
    """The C program on the study of `ours`: the same lanes, parameters and steps."""

    def __init__(self, ours: Ours, threads: int) -> None:
        study = ours.study
        self._kind, self._count = str(study.kind), study.size
        self._library = library(self._kind, single := study.precision == "float32")
        real = np.float32 if single else np.float64
        self._library.omp_set_num_threads(threads)
        p = study.prepared.model.parameters
        storage = float(storage_factor(p.storage_months, p.storage_temperature_degC))
        values = [p.capacity_Ah, p.initial_soc, storage, AMBIENT_DEGC, *(getattr(p, name) for name in _CELL)]
        if self._kind == "robot":
            values += [p.n_series, p.n_motors, DUTY, p.onboard_current_A, *(getattr(p, name) for name in _MOTOR)]
        lanes = study.lanes(np.arange(study.size))
        load = lanes["current_A" if self._kind == "cell" else "load_torque_Nm"]
        self._parameters = np.array([float(value) for value in values], dtype=real)
        self._lanes = [np.array(x, dtype=real) for x in (load, jax.vmap(cycle_resistance)(lanes["cycles"]))]
        self._steps = [np.array(ours.course.duration_s, dtype=real)]
        if self._kind == "robot":
            self._steps.append(np.array(ours.course.ends_row, dtype=np.int8))
        self._results = [np.empty(study.size, dtype=real), np.empty(study.size, dtype=real)]

    def __call__(self) -> list[np.ndarray]:
        """Run all lanes and return their final SOC and least voltage."""
        getattr(self._library, f"run_{self._kind}s")(
            _place(self._parameters),
            ctypes.c_long(self._count),
            *map(_place, self._lanes),
            ctypes.c_long(self._steps[0].size),
            *map(_place, self._steps),
            *map(_place, self._results),
        )
        return self._results


def _place(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)
