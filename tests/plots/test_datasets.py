"""Pictures of a data set without further arguments: which are drawn, and over which axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from jaxmodel import Status, sensitivity, sweeps
from jaxmodel.base.errors import SweepError
from jaxmodel.plots.datasets import MOST_DRAWN, pictures_of, save_pictures, thinned
from jaxmodel.plots.global_indices import bars
from jaxmodel.plots.lanes import panels, points
from jaxmodel.plots.sensitivities import doubling_beside_gradient, interaction_matrix, over_time
from jaxmodel.plots.style import new_figure
from jaxmodel.plots.sweeps import family, heat_map, metric_curves
from jaxmodel.plots.uncertainty import bands_over_time


def grid(**sizes: int) -> xr.Dataset:
    """A result whose metric grows by 1, 10, 100, ... per step of each axis: the last matters most."""
    names, shape = list(sizes), tuple(sizes.values())
    places = np.indices(shape, sparse=True)
    values = sum(10.0**number * place for number, place in enumerate(places))
    return xr.Dataset(
        {"energy_Wh": (names, values, {"units": "W h"}), "status": (names, np.zeros(shape, dtype=np.int8))},
        {name: 100.0 + np.arange(size) for name, size in sizes.items()},
    )


@pytest.fixture(scope="module")
def study() -> sweeps.Study:
    return sweeps.Study(
        kind="cell",
        metrics=["final_soc", "min_voltage_V"],
        store=["voltage_V"],
        profile={"duration_s": 40, "step_s": 10, "current_A": 2.0, "ambient_degC": 20.0},
        sample={"count": 8, "ranges": {"capacity_Ah": (2.0, 4.0), "current_A": (1.0, 2.0)}},
    )


def test_a_map_says_which_axis_changes_nothing() -> None:
    dataset = grid(a=2, b=3)
    assert heat_map(dataset).axes[0].get_title(loc="right") == ""
    still = dataset.assign(energy_Wh=dataset["energy_Wh"].isel(a=0) + 0.0 * dataset["energy_Wh"])
    assert heat_map(still).axes[0].get_title(loc="right") == "a changes nothing here"
    assert "a changes nothing here" not in str(panels(grid(a=2, b=2, c=2)).get_suptitle())
    over_c = still.expand_dims(c=[1.0, 2.0])
    assert panels(over_c).get_suptitle() == "c and a change nothing here"


def test_lanes_that_are_impossible_are_hatched() -> None:
    dataset = grid(a=2, b=3)
    assert not heat_map(dataset).axes[0].patches
    dataset["status"][1, 2] = Status.IMPOSSIBLE
    (patch,) = heat_map(dataset).axes[0].patches
    assert patch.get_hatch() == "////"
    assert "hatched" in heat_map(dataset).axes[0].get_xlabel()


def test_pictures_of_a_large_result_are_of_a_part_of_its_lanes(tmp_path: Path) -> None:
    dataset = grid(a=300, b=200, c=4, d=5)
    thin = thinned(dataset)
    assert MOST_DRAWN / 2 < thin["energy_Wh"].size <= MOST_DRAWN
    assert (thin.sizes["c"], thin.sizes["d"]) == (4, 5)
    assert {path.name for path in save_pictures(dataset, tmp_path)} == {
        "parallel.png", "energy_Wh.png", "energy_Wh-curves.png"
    }  # fmt: skip
    assert (tmp_path / "parallel.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_axes_that_matter_most_are_drawn_and_the_others_held_at_their_middle() -> None:
    axes = heat_map(grid(a=2, b=3, c=4)).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("c", "b")
    assert axes.get_title(loc="left") == "a = 101"
    lines = metric_curves(grid(a=2, b=3, c=4)).axes[0]
    assert lines.get_xlabel() == "c"
    assert [line.get_ydata()[1] for line in lines.lines] == [101.0, 111.0, 121.0]  # at c = 1, a = 1
    across = panels(grid(a=2, b=3, c=4)).axes
    assert [one.get_title(loc="left") for one in across[:2]] == ["a = 100", "a = 101"]


def test_named_axes_are_drawn_and_too_few_are_a_mistake() -> None:
    axes = heat_map(grid(a=2, b=3, c=4), x="a").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("a", "c")
    with pytest.raises(SweepError, match="this picture takes 2 axes, and the result varies along a"):
        heat_map(grid(a=3))
    with pytest.raises(SweepError, match="this result has no column over time"):
        family(grid(a=3))
    with pytest.raises(SweepError, match=r"neither of sweeps\.run nor of a sensitivity analysis"):
        pictures_of(xr.Dataset())


def test_sample_is_drawn_over_what_its_metric_follows(study: sweeps.Study) -> None:
    dataset = sweeps.run(study)
    assert {name for name, _ in pictures_of(dataset)} == {"final_soc", "min_voltage_V", "voltage_V-over-time"}
    assert "current" in points(dataset, "min_voltage_V").axes[0].get_xlabel()
    assert len(family(dataset).axes[0].lines) == 2 * 8  # of each lane its line, and a dashed one that no slope fills


def test_every_analysis_has_its_pictures(study: sweeps.Study) -> None:
    local = sensitivity.local(study)
    assert {name for name, _ in pictures_of(local)} == {
        "elasticities", "doubling-final_soc", "doubling-min_voltage_V", "over-time-voltage_V"
    }  # fmt: skip
    assert "final soc" in doubling_beside_gradient(local).axes[0].get_xlabel().replace("_", " ")
    assert "voltage" in over_time(local).get_suptitle()
    pairs = sensitivity.interactions(study, ["capacity_Ah", "current_A", "cycles"])
    assert {name for name, _ in pictures_of(pairs)} == {"interactions-final_soc", "interactions-min_voltage_V"}
    assert "final soc" in interaction_matrix(pairs).axes[0].get_title(loc="left").replace("_", " ")
    spread = sensitivity.uncertainty(study, {"capacity_Ah": 0.1}, draws=16)
    assert {name for name, _ in pictures_of(spread)} == {"uncertainty", "uncertainty-voltage_V"}
    assert "voltage" in bands_over_time(spread).axes[0].get_ylabel()
    indices = sensitivity.global_indices(study, count=32)
    assert {"sobol-final_soc", "pairs-final_soc", "convergence-final_soc"} <= {name for name, _ in pictures_of(indices)}
    assert "final soc" in bars(indices).axes[0].get_xlabel().replace("_", " ")
    axes = study.replace(sample=None, axes={"current_A": [1.0, 2.0], "ambient_degC": [0.0, 30.0]})
    over_axes = sensitivity.elasticity_map(axes)
    assert {name for name, _ in pictures_of(over_axes)} == {
        "elasticity-map-final_soc", "elasticity-map-min_voltage_V"
    }  # fmt: skip


def test_a_picture_of_one_axes_is_drawn_on_those_of_the_caller():
    data = grid(ambient_degC=3, load_torque_Nm=4)
    own = new_figure(16.0, 8.0)
    left, right = own.subplots(1, 2)
    assert heat_map(data, ax=left) is own
    assert metric_curves(data, ax=right) is own
    assert len(left.collections) == len(heat_map(data).axes[0].collections)
    assert [line.get_ydata().tolist() for line in right.lines] == [
        line.get_ydata().tolist() for line in metric_curves(data).axes[0].lines
    ]
