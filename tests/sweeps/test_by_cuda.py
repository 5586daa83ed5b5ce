"""A sweep on GPUs, with a driver that runs the kernel on the host: how lanes are cut, ordered and put together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest

from jaxmodel import sweeps
from jaxmodel.lanes import CudaError, CudaKernel, cuda
from jaxmodel.sweeps import Study, by_cuda, lane_kernel, plan
from tests.lanes.driver import Driver
from tests.sweeps.test_by_vectors import STUDIES

STUDY: dict[str, Any] = {
    "kind": "cell",
    "profile": {"duration_s": 600, "step_s": 60, "ambient_degC": 20.0},
    "axes": {"current_A": list(np.linspace(0.5, 5.0, 25)), "cycles": list(np.linspace(0.0, 400.0, 8))},
    "metrics": ["final_soc", "min_voltage_V"],
    "store": ["voltage_V"],
    "store_every": 120,
}


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Driver:
    """Two GPUs, as JAX would show them."""
    driver = Driver()
    monkeypatch.setattr(cuda, "_driver", lambda: driver)
    loaded = CudaKernel.on

    def on(kernel: CudaKernel, number: int, shared: Any) -> Any:
        driver.knows(kernel)
        return loaded(kernel, number, shared)

    monkeypatch.setattr(CudaKernel, "on", on)
    client = SimpleNamespace(platform_version="cuda 13000")
    gpus = [
        SimpleNamespace(platform="gpu", client=client, local_hardware_id=number, device_kind="GPU") for number in (0, 1)
    ]
    mesh = SimpleNamespace(devices=np.array(gpus), size=2)
    monkeypatch.setattr("jaxmodel.sweeps.runner.lane_mesh", lambda devices: mesh)
    return driver


def test_lanes_are_those_of_the_processor(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(by_cuda, "ACCELERATOR", 1)
    monkeypatch.setattr(by_cuda, "LANE_STEPS_PER_CALL", 300)
    on_gpu = sweeps.run(Study(**STUDY))
    assert len(driver.launches) > 3
    assert sum(driver.launches) == 200
    monkeypatch.undo()
    on_processor = sweeps.run(Study(**STUDY))
    for name in ("final_soc", "min_voltage_V", "voltage_V", "status"):
        np.testing.assert_allclose(on_gpu[name], on_processor[name], rtol=1e-13)


def test_call_that_finds_too_little_memory_is_halved(driver: Driver) -> None:
    whole = sweeps.run(Study(**STUDY))
    assert driver.launches == [200]
    alone = driver.launches.copy()
    driver.cuMemGetInfo_v2 = _much_is_free  # it is not, because another program takes it
    driver.allowed = 9_000
    cut = sweeps.run(Study(**STUDY))
    assert max(driver.launches[len(alone) :]) < 200
    assert cut.drop_attrs().identical(whole.drop_attrs())


def _much_is_free(free: Any, total: Any) -> int:
    free._obj.value = total._obj.value = 2**40
    return 0


def test_float32_is_computed_on_a_gpu_too(driver: Driver) -> None:
    single = sweeps.run(Study(**STUDY, precision="float32"))
    double = sweeps.run(Study(**STUDY))
    difference = np.abs(single["final_soc"].values - double["final_soc"].values)
    assert 0.0 < difference.max() < 1e-6


def test_gpu_that_takes_no_kernel_is_used_through_xla(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(kernel: CudaKernel, number: int, shared: Any) -> Any:
        raise CudaError("cuModuleLoadData: the provided PTX was compiled with an unsupported toolchain")

    monkeypatch.setattr(CudaKernel, "on", refuse)
    runner = sweeps.runner.Runner(Study(**STUDY))
    assert not runner.as_kernel()
    assert runner.program == "XLA"
    assert runner.remark.startswith("The sweep runs through XLA: the GPU takes no kernel (cuModuleLoadData")


def test_processor_is_no_gpu() -> None:
    assert not by_cuda.is_cuda(jax.devices("cpu")[0])


@pytest.mark.slow("robot, all effects, cut-off")
@pytest.mark.parametrize("what", STUDIES)
def test_kernel_calls_nothing_outside(what: str) -> None:
    study = Study(**STUDIES[what])
    prepared = study.prepared
    keep = sweeps.lane.Keep(prepared.metrics, tuple(study.store))
    stepped = sweeps.lane.lay_out(prepared.model, prepared.profile, prepared.stored_rows)
    shared = jax.tree.map(np.asarray, (prepared.model, stepped, prepared.cutoff))
    ptx = lane_kernel.kernel_of_a_lane(CudaKernel, keep, shared, study.lanes, False).ptx
    assert ".visible .entry" in ptx
    assert ".extern" not in ptx


def test_chunks_of_a_gpu_are_larger() -> None:
    lanes = [plan.lanes_per_chunk(10**8, 1800, 40, 2**40, times=times) for times in (1, plan.ACCELERATOR)]
    assert lanes[1] > 200 * lanes[0]
