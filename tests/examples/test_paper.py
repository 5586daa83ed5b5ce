"""The paper's numbers: how they derive from its tables, what the engine gives, and its report."""

from __future__ import annotations

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from examples.paper import __main__ as paper_report
from examples.paper import discharges
from examples.paper.no_load import activation_energy, gradients, soc_at_rest
from examples.paper.page import Picture, Section, Table, percent, power, write_page
from examples.paper.printed import (
    STEP_PER_20_K,
    STEP_PER_50_MNM,
    TABLE_1,
    TABLE_2,
    TESTS,
    cycle_ohm,
    headline,
    share_left,
)
from jaxmodel.base.schema import with_schema
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.model.cell import cycle_resistance, storage_factor
from jaxmodel.operation.compensation import SHARE_PER_20_K, SHARE_PER_50_MNM
from jaxmodel.plots import new_figure


def test_headlines_are_the_tables_by_one_of_their_own_slopes() -> None:
    by_temperature, by_torque = headline(TABLE_1, 20.0, 20.0), headline(TABLE_2, 0.05, 0.3)
    # The paper divides by seven rows, rounds, and takes the slope at 20 degC.
    assert round(by_temperature.per_row * 1e4, 2) == pytest.approx(STEP_PER_20_K * 1e4)
    assert STEP_PER_20_K / 2.1e-4 == pytest.approx(SHARE_PER_20_K, abs=5e-4)
    # Over its six intervals the table says more.
    assert by_temperature.share == pytest.approx(2.3 / 6.0 / 2.1, rel=1e-9)
    assert round(-by_torque.per_interval * 1e4, 1) == pytest.approx(STEP_PER_50_MNM * 1e4)
    assert STEP_PER_50_MNM / 3.4e-4 == pytest.approx(SHARE_PER_50_MNM, abs=5e-4)


def test_equations_7_and_8_as_printed_are_those_of_the_model() -> None:
    assert cycle_ohm(400.0) == pytest.approx(float(cycle_resistance(jnp.asarray(400.0))), rel=1e-12)
    for months, degC in ((0.0, 20.0), (18.0, 20.0), (36.0, 45.0)):
        modelled = float(storage_factor(jnp.asarray(months), jnp.asarray(degC)))
        assert share_left(months, degC) == pytest.approx(modelled, rel=1e-12)


def test_page_has_every_part_and_escapes_what_it_is_given(tmp_path: Path) -> None:
    table = Table("numbers", ("what", "[V]"), [("<b>", "1.5")])
    parts = ["R < 1 & more", table, Picture("dot", new_figure(4.0, 3.0), "a figure")]
    source = tmp_path / "source.toml"
    source.write_text("", encoding="utf-8")
    write_page(tmp_path, "title", "under", ["found"], [Section("section", parts)], [source])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "R &lt; 1 &amp; more" in page
    assert '<td>&lt;b&gt;</td><td class="n">1.5</td>' in page
    assert "e3b0c44298fc1c14" in page  # SHA-256 of nothing
    assert (tmp_path / "numbers.csv").read_text(encoding="utf-8").splitlines() == ["what,[V]", "<b>,1.5"]
    assert (tmp_path / "dot.png").read_bytes().startswith(b"\x89PNG")
    assert (power(-0.00001, -4, 0), power(2.05e-4, -4), percent(0.123), percent(-0.0001)) == (
        "0",
        "2.05",
        "+12.3 %",
        "0.0 %",
    )


def test_table_5_is_table_3_over_the_time_at_which_the_last_digit_fell() -> None:
    implied = [(t.final_V - t.initial_V) / 6.0 / t.gradient_V_s for t in TESTS if t.gradient_V_s]
    assert np.round(implied).tolist() == [833.0, 980.0, 980.0]


def test_table_4_falls_with_one_activation_energy() -> None:
    energies = [activation_energy(0.012, 0.0055), activation_energy(0.04, 0.018)]
    assert energies[0] == pytest.approx(energies[1], rel=0.05)
    assert activation_energy(np.exp(1.0), 1.0) == pytest.approx(8.314 / (1.0 / 293.15 - 1.0 / 303.15))


@pytest.fixture(scope="module")
def slopes() -> dict[str, dict[float, float]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discharges, "FIDELITIES", ("formula",))
        patch.setattr(discharges, "STEP_S", 30.0)
        patch.setattr(discharges, "STORED_EVERY", 60)
        data = discharges.discharges()
        return {axis: discharges.slopes(data, "formula", axis) for axis in ("ambient_degC", "load_torque_Nm")}


def test_engine_reproduces_table_2_and_not_table_1(slopes: dict[str, dict[float, float]]) -> None:
    assert discharges.misfit(slopes["load_torque_Nm"], TABLE_2)[1] < 0.031
    flat = np.array(list(slopes["ambient_degC"].values()))
    assert np.ptp(flat) < 1e-3 * abs(flat.mean())
    assert discharges.misfit(slopes["ambient_degC"], TABLE_1)[1] > 3.0


def test_storage_at_the_ambient_bends_table_1_the_wrong_way(slopes: dict[str, dict[float, float]]) -> None:
    stored = discharges.with_storage_at_ambient(slopes["ambient_degC"], 18.0)
    assert stored[20.0] == slopes["ambient_degC"][20.0]
    assert stored[-20.0] > stored[20.0] > stored[40.0]  # flatter in the cold: the table is steeper there
    assert np.isnan(stored[100.0])


def test_gradients_of_a_known_cubic() -> None:
    time_s = np.arange(0.0, 3001.0, 10.0)
    volts = 4.0 - 5e-5 * time_s + 1e-12 * time_s**3
    found = gradients(time_s, volts)
    np.testing.assert_allclose(found.cubic, (1e-12, 0.0, -5e-5, 4.0), atol=1e-9)
    assert found.cubic_mean == pytest.approx((volts[-1] - volts[1]) / 2990.0)
    straight = gradients(time_s, 4.0 - 3e-5 * time_s)
    assert (straight.linear, straight.first_order) == pytest.approx((-3e-5, -3e-5))


def test_charge_that_rests_at_the_measured_voltage() -> None:
    soc = soc_at_rest(22.6 / 6.0)
    assert -1.031 * np.exp(-35 * soc) + 3.685 + 0.2156 * soc - 0.1178 * soc**2 + 0.3201 * soc**3 == pytest.approx(
        22.6 / 6
    )


def test_table_1_as_a_case_is_the_printed_table() -> None:
    case = read_case(paper_report.EXAMPLE)
    for run in case.runs:
        ambient = float(run.measured.inputs["ambient_degC"][0])
        left = run.measured.outputs["soc"][-1]
        assert left == pytest.approx(1.0 + 1800.0 * TABLE_1[ambient], abs=1e-9)
    assert sorted(float(run.measured.inputs["ambient_degC"][0]) for run in case.runs) == list(TABLE_1)


def test_experiment_as_a_case_is_the_printed_table() -> None:
    case = read_case(paper_report.EXAMPLE.parent / "paper_experiment")
    read = [
        (inputs["ambient_degC"][0], inputs["duty"][0] < 1.0, *outputs["pack_voltage_V"][[0, -1]])
        for inputs, outputs in ((run.measured.inputs, run.measured.outputs) for run in case.runs)
    ]
    assert read == [(test.ambient_degC, test.compensated, test.initial_V, test.final_V) for test in TESTS]


def test_diagnosis_of_table_1_is_told_as_it_came(
    diagnosis: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paper_report, "diagnose", lambda case, **_: diagnosis)
    answer, origin = paper_report._diagnosis(tmp_path)
    assert json.loads((tmp_path / "answer.json").read_text(encoding="utf-8")) == with_schema(answer)
    assert (tmp_path / "extended.toml").is_file()
    assert "computed with this report" in origin
    assert "recorded" in paper_report._recorded()[1]
