"""The posterior of a fitted model as draws: its numbers, what they predict, and that ArviZ reads it."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from jaxmodel import Investigation, case_model, read_case, run_profile, simulate, with_values
from tests.export.other_python import run_by

HERE = Path(__file__).parent
DRAWS = 400


@pytest.fixture(scope="module")
def investigation() -> Investigation:
    return Investigation(read_case("examples/samsung_30q"), progress=False)


@pytest.fixture(scope="module")
def tree(investigation: Investigation) -> xr.DataTree:
    return investigation.to_xarray(DRAWS)


def coordinates_of(investigation: Investigation, tree: xr.DataTree) -> tuple[list[int], np.ndarray]:
    """Places of the unknowns, and their coordinates in each draw (draws, unknowns)."""
    layout = investigation.cache.space.layout
    place_of = {layout.name_of(place): place for place in investigation.model.spec.free}
    places = [place_of[str(name)] for name in tree["posterior"].data_vars]
    drawn = tree["posterior"].to_dataset().to_array().to_numpy()[:, 0]
    found = [[layout.coordinates[p].at(v) for v in values] for p, values in zip(places, drawn, strict=True)]
    return places, np.array(found).T


def test_draws_have_the_sd_of_the_tables_and_the_correlations_of_the_fit(
    investigation: Investigation, tree: xr.DataTree
) -> None:
    table = investigation.parameters().set_index("name")
    assert list(tree["posterior"].data_vars) == list(table.index)
    fit = investigation.model
    places, x = coordinates_of(investigation, tree)
    told = [fit.spec.free.index(place) for place in places]
    np.testing.assert_allclose(x.std(axis=0), fit.sd[told], rtol=4.0 / np.sqrt(2.0 * DRAWS))
    assert (np.abs(x.mean(axis=0) - fit.free[told]) < 4.0 * fit.sd[told] / np.sqrt(DRAWS)).all()
    covariance = fit.covariance[np.ix_(told, told)]
    sd = np.sqrt(np.diag(covariance))
    expected = covariance / np.outer(sd, sd)
    assert np.abs(np.corrcoef(x.T) - expected).max() < 4.0 / np.sqrt(DRAWS)
    # One is far beyond what so few draws scatter, so that a draw without correlations would fail.
    assert np.abs(expected - np.eye(len(sd))).max() > 6.0 / np.sqrt(DRAWS)
    for name in table.index:
        assert tree["posterior"][name].attrs["units"] == table.loc[name, "unit"]
        assert tree["posterior"][name].attrs["sd_of_fit"] == table.loc[name, "sd"]


def test_a_draw_predicts_what_its_case_simulates(investigation: Investigation, tree: xr.DataTree) -> None:
    """Numbers of a draw, written into the case, give the prediction of the draw."""
    predicted = tree["posterior_predictive"].to_dataset().isel(chain=0, draw=7)
    drawn = {str(name): jnp.asarray(values[0, 7].item()) for name, values in tree["posterior"].data_vars.items()}
    case, run = investigation.case, investigation.case.runs[1]
    model = with_values(
        case_model(case, run),
        {name: value for name, value in drawn.items() if "[" not in name} | {"initial_soc": drawn["initial_soc[cc2C]"]},
    )
    simulated = simulate(model, run_profile(run)).readings["voltage_V"]
    found = predicted["voltage_V"].to_numpy()[predicted["voltage_V_run"].to_numpy() == 1]
    np.testing.assert_allclose(found, simulated, atol=1e-6)
    assert np.abs(found - tree["constant_data/voltage_V_best"].to_numpy()[: found.size]).max() > 1e-3


def test_scores_are_those_of_the_weights(investigation: Investigation, tree: xr.DataTree) -> None:
    weight = investigation.model.likelihood.channels["voltage_V"]
    observed = tree["observed_data/voltage_V"]
    errors = observed.to_numpy() - tree["posterior_predictive/voltage_V"].to_numpy()
    density = np.exp(-0.5 * (errors / weight.sd) ** 2) / (weight.sd * np.sqrt(2.0 * np.pi))
    np.testing.assert_allclose(tree["log_likelihood/voltage_V"], np.log(density) / weight.inflation, atol=1e-12)
    assert float(tree["constant_data/voltage_V_inflation"]) == weight.inflation > 1.0
    constant = tree["constant_data"]
    np.testing.assert_allclose(constant["voltage_V_best"] + constant["voltage_V_residual"], observed)
    rows = investigation.cache.view.data.by_channel["voltage_V"]
    expected = np.concatenate([investigation.model.errors[one] for one in rows])
    np.testing.assert_array_equal(constant["voltage_V_residual"], expected)


def test_every_reading_says_its_run_and_time(investigation: Investigation, tree: xr.DataTree) -> None:
    observed = tree["observed_data"].to_dataset()
    meanings = observed["voltage_V_run"].attrs["flag_meanings"].split()
    assert meanings == ["cc1C", "cc2C", "cc3C"]
    first = observed.isel(voltage_V_reading=observed["voltage_V_run"].to_numpy() == 1)
    run = investigation.case.runs[1]
    np.testing.assert_array_equal(first["voltage_V"], run.measured.outputs["voltage_V"])
    np.testing.assert_array_equal(first["voltage_V_time_s"], run.measured.time_s)


def test_it_says_that_nothing_was_sampled(tree: xr.DataTree) -> None:
    assert "no Markov chain" in tree["posterior"].attrs["comment"]
    assert "independent readings" in tree["log_likelihood"].attrs["comment"]


def test_arviz_reads_it(tree: xr.DataTree, tmp_path: Path) -> None:
    tree.to_zarr(tmp_path / "posterior.zarr", consolidated=False)
    found = run_by("arviz", str(HERE / "by_arviz.py"), tmp_path / "posterior.zarr")
    assert set(found["groups"]) == set(tree.children)
    for name, values in tree["posterior"].data_vars.items():
        assert found["mean"][name] == pytest.approx(float(values.mean()), rel=1e-9)
    for name, scores in tree["log_likelihood"].data_vars.items():
        assert found["readings"][name] == scores.sizes[f"{name}_reading"]
        # Of so many readings one that is left out hardly moves the posterior.
        assert found["elpd"][name] == pytest.approx(float(scores.mean("draw").sum()), abs=5.0)
