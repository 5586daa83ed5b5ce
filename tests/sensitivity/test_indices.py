"""Global indices against functions whose indices are known, through the code that studies go through."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

from jaxmodel.base.errors import SweepError
from jaxmodel.sensitivity.global_study import global_indices, ranges_of
from jaxmodel.sensitivity.indices import Design, analyse, make_design
from jaxmodel.sweeps.study import Study

NAMES = ("x1", "x2", "x3")
A, B = 7.0, 0.1  # of the Ishigami function
WEIGHTS = np.array([0.0, 1.0, 4.5, 9.0])  # of the g-function


def ishigami(points: np.ndarray) -> np.ndarray:
    x = np.pi * (2.0 * points - 1.0)
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_indices() -> tuple[np.ndarray, np.ndarray, float]:
    """First and total indices, and that of the pair (1, 3)."""
    v1 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    v2 = A**2 / 8.0
    v13 = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = v1 + v2 + v13
    return np.array([v1, v2, 0.0]) / whole, np.array([v1 + v13, v2, v13]) / whole, v13 / whole


def g_function(points: np.ndarray) -> np.ndarray:
    return np.prod((np.abs(4.0 * points - 2.0) + WEIGHTS) / (1.0 + WEIGHTS), axis=1)


def g_indices() -> tuple[np.ndarray, np.ndarray]:
    partial = 1.0 / (3.0 * (1.0 + WEIGHTS) ** 2)
    whole = np.prod(1.0 + partial) - 1.0
    return partial / whole, partial * np.prod(1.0 + partial) / (1.0 + partial) / whole


@pytest.fixture(scope="module")
def design() -> Design:
    return make_design("sobol", NAMES, 4000)


@pytest.fixture(scope="module")
def data(design: Design) -> xarray.Dataset:
    return analyse(design, {"ishigami": ishigami(design.points), "constant": np.ones(len(design.points))})


def test_sobol_indices_of_ishigami(data: xarray.Dataset):
    first, total, pair = ishigami_indices()
    one = data.sel(metric="ishigami")
    assert data.attrs["blocks"] == 4096
    np.testing.assert_allclose(one["first"], first, atol=0.015)
    np.testing.assert_allclose(one["total"], total, atol=0.015)
    assert float(one["second"].sel(factor="x1", other="x3")) == pytest.approx(pair, abs=0.03)
    assert float(one["second"].sel(factor="x3", other="x1")) == float(one["second"].sel(factor="x1", other="x3"))
    assert abs(float(one["second"].sel(factor="x1", other="x2"))) < 0.03
    # Quasi-random points do better than the bootstrap of them thinks: the truth is well within its intervals.
    assert np.all(np.abs(one["first"] - first) <= one["first_error"])
    assert np.all(np.abs(one["total"] - total) <= one["total_error"])


def test_what_does_not_vary_has_no_indices(data: xarray.Dataset):
    constant = data.sel(metric="constant")
    for name in ("first", "total", "second"):
        assert np.all(np.isnan(constant[name]))


def test_estimates_converge_with_the_blocks(data: xarray.Dataset):
    first, *_ = ishigami_indices()
    one = data.sel(metric="ishigami")
    assert list(one["blocks"].values) == [16, 32, 64, 128, 256, 512, 1024, 2048, 4096]
    np.testing.assert_array_equal(one["first_converging"].sel(blocks=4096), one["first"])
    away = np.abs(one["first_converging"] - first).max("factor")
    assert float(away.sel(blocks=4096)) < 0.1 * float(away.sel(blocks=[16, 32]).max())
    error = one["first_converging_error"].sel(factor="x1")
    assert float(error.sel(blocks=4096)) == pytest.approx(0.25 * float(error.sel(blocks=256)), rel=0.35)  # 1/sqrt(n)


def test_sobol_indices_of_the_g_function():
    design = make_design("sobol", ("a", "b", "c", "d"), 4096, second_order=False)
    assert design.rows == 6
    data = analyse(design, {"g": g_function(design.points)}).sel(metric="g")
    first, total = g_indices()
    np.testing.assert_allclose(data["first"], first, atol=0.02)
    np.testing.assert_allclose(data["total"], total, atol=0.02)
    assert "second" not in data


def test_blocks_with_a_failed_run_are_left_out_and_counted(design: Design):
    values = ishigami(design.points)
    failed = np.random.default_rng(3).choice(values.size, 200, replace=False)
    values[failed] = np.nan
    data = analyse(design, {"y": values})
    assert data.attrs["failed"] == 200
    hit = np.unique(failed // design.rows).size
    assert int(data["blocks_used"][0]) == 4096 - hit
    first, total, _ = ishigami_indices()
    np.testing.assert_allclose(data["first"][0], first, atol=0.04)
    np.testing.assert_allclose(data["total"][0], total, atol=0.04)


def test_groups_take_their_parameters_together():
    """x1 and x3 act on each other alone: together they have all that x2 has not, and nothing is left between groups."""
    design = make_design("sobol", NAMES, 4096, {"pair": ["x1", "x3"]})
    assert design.factors == ("pair", "x2")
    data = analyse(design, {"y": ishigami(design.points)}).sel(metric="y")
    of_x2 = ishigami_indices()[0][1]
    np.testing.assert_allclose(data["first"], [1.0 - of_x2, of_x2], atol=0.02)
    np.testing.assert_allclose(data["total"], [1.0 - of_x2, of_x2], atol=0.02)


def test_morris_finds_the_slopes_of_a_plane_and_what_bends():
    design = make_design("morris", NAMES, 60)
    x = design.points
    data = analyse(design, {"plane": 3.0 * x[:, 0] - 2.0 * x[:, 1], "bent": x[:, 0] * x[:, 2]})
    plane, bent = data.sel(metric="plane"), data.sel(metric="bent")
    np.testing.assert_allclose(plane["mu"], [3.0, -2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(plane["mu_star"], [3.0, 2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(plane["sigma"], 0.0, atol=1e-9)
    np.testing.assert_allclose(bent["mu_star"], [0.5, 0.0, 0.5], atol=0.1)  # the mean of the other over its levels
    assert np.all(bent["sigma"].values[[0, 2]] > 0.2)
    groups = analyse(make_design("morris", NAMES, 60, {"pair": ["x1", "x3"]}), {"y": np.zeros(180)})
    assert list(groups["factor"].values) == ["pair", "x2"]


def test_dgsm_of_ishigami_is_its_mean_squared_slope_and_bounds_the_total():
    design = make_design("dgsm", NAMES, 4096)
    data = analyse(design, {"y": ishigami(design.points)}).sel(metric="y")
    squares = np.array(
        [
            0.5 * (1.0 + 2.0 * B * np.pi**4 / 5.0 + B**2 * np.pi**8 / 9.0),
            A**2 / 2.0,
            8.0 * B**2 * np.pi**6 / 7.0,
        ]
    )
    whole = 0.5 + A**2 / 8.0 + B * np.pi**4 / 5.0 + B**2 * np.pi**8 / 18.0
    expected = squares * 4.0 / whole  # (2 pi)^2 / pi^2
    np.testing.assert_allclose(data["dgsm"], expected, rtol=0.05)
    assert np.all(data["dgsm"] > ishigami_indices()[1])
    assert np.all(np.abs(data["dgsm"] - expected) < data["dgsm_error"])
    assert np.all(data["dgsm_error"] < 0.15 * data["dgsm"])


def study(**changes) -> Study:
    fields = {
        "kind": "cell",
        "metrics": ["final_soc"],
        "profile": {"duration_s": 600.0, "step_s": 60.0, "current_A": 5.0, "ambient_degC": 20.0},
        "parameters": {"storage_months": 0.0},
        "axes": {"ambient_degC": [10.0], "initial_soc": [0.6, 0.8, 0.9]},
        "sample": {"count": 4, "ranges": {"current_A": [1.0, 5.0], "cycles": [0.0, 100.0]}},
        "cutoff": {},
    }
    return Study(**(fields | changes))


def test_indices_of_a_study_are_those_of_its_equation():
    """Eq. 1: SOC = SOC_0 - i t/(3600 Q), straight in both; an axis of one value stays, cycles do not matter."""
    assert {name: (span.low, span.high) for name, span in ranges_of(study()).items()} == {
        "initial_soc": (0.6, 0.9),
        "current_A": (1.0, 5.0),
        "cycles": (0.0, 100.0),
    }
    data = global_indices(study(), count=512, second_order=False)
    assert data.attrs["runs"] == 512 * 5
    variance = np.array([0.3, 4.0 * 600.0 / 3600.0 / 5.2, 0.0]) ** 2
    expected = variance / variance.sum()
    one = data.sel(metric="final_soc")
    np.testing.assert_allclose(one["first"], expected, atol=0.02)
    np.testing.assert_allclose(one["total"], expected, atol=0.02)
    assert list(data["high"].values) == [0.9, 5.0, 100.0]


def test_logarithmic_range_is_drawn_in_its_logarithm():
    """The charge used goes as 1/Q: ln of it is straight in ln Q, so that Morris' effect of a log range is that of e."""
    spans = {"capacity_Ah": {"low": 2.0, "high": 8.0, "spacing": "log"}, "cycles": [0.0, 100.0]}
    data = global_indices(study(axes={}, sample={"count": 4, "ranges": spans}), "morris", count=20)
    used = 5.0 * 600.0 / 3600.0
    levels = used / (2.0 * 4.0 ** np.arange(0.0, 1.01, 1.0 / 3.0))
    effects = (levels[:2] - levels[2:]) / (2.0 / 3.0)  # steps of two levels of three
    mu = float(data["mu"].sel(metric="final_soc", factor="capacity_Ah"))
    assert np.min(effects) < mu < np.max(effects)
    assert float(data["mu_star"].sel(metric="final_soc", factor="cycles")) < 1e-12


@pytest.mark.parametrize(
    ("method", "count", "groups", "message"),
    [
        ("fast", 64, None, "use one of sobol, morris, dgsm"),
        ("sobol", 1, None, "at least two"),
        ("sobol", 64, {"g": ["x9"]}, "'x9' does not vary"),
        ("sobol", 64, {"g": ["x1"], "h": ["x1"]}, "in group g already"),
        ("sobol", 64, {"g": ["x1", "x2", "x3"]}, "two parameters or groups"),
        ("dgsm", 64, {"g": ["x1"]}, "one parameter each"),
    ],
)
def test_what_cannot_be_done_is_said(method: str, count: int, groups: dict | None, message: str):
    with pytest.raises(SweepError, match=message):
        make_design(method, NAMES, count, groups)
