"""Presets: whole, within bounds, of use to their kinds alone, second to a case's own entries, as good as documented."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.base.errors import ParameterError, SweepError
from jaxmodel.case.build import case_model, preset_model
from jaxmodel.case.known import Known, Table
from jaxmodel.case.measurements import KINDS
from jaxmodel.case.presets import PRESETS, read_form, read_preset
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.data.importing import import_case
from jaxmodel.model.names import with_values
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.simulation import Trajectory, run_track
from jaxmodel.sweeps import read_study
from tests.model.runs import padded, run

REPOSITORY = Path(__file__).parents[2]
DATA = REPOSITORY.parent / "shared" / "data"
MADE = [name for name in PRESETS if name != "paper"]
CELLS = [name for name in MADE if "cell" in read_form(name).kinds]
ROWS = 3200  # one compiled shape for the longest run held out here and for all others
UNITS = {"voltage_V": (1e3, "mV"), "speed_rad_s": (1, "rad/s"), "current_A": (1, "A")}
UNITS |= {"cell_temperature_degC": (1, "K")}
# By preset the data set, the run held out, and how it is imported.
HELD_OUT: dict[str, tuple[str, str, dict[str, Any]]] = {
    "samsung_30q": ("samsung_30q_18650/cell1_cc2C.csv", "cell1_cc2C", {"ambient": 23.0}),
    "lg_mj1": ("lg_mj1_18650/pulse_10pctSOC_p28degC.csv", "pulse_10pctSOC_p28degC", {}),
    "k2_lfp_26650": ("k2_lfp_26650/cc1C_p30degC.csv", "cc1C_p30degC", {}),
}
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside the repository")


def case_with(preset: str, kind: str, **changes: Any) -> Case:
    case = Case("bench", Path("bench/case.toml"), "", "cell", preset, {}, {}, {}, {}, (), {})
    return dataclasses.replace(case, kind=kind, **changes)


def figure(name: str, of_run: str, column: str = "voltage_V") -> float:
    (found,) = [entry.rms for entry in read_form(name).held_out if (entry.run, entry.column) == (of_run, column)]
    return found


def run_of_cell(name: str, profile: Profile, initial_soc: float = 1.0) -> Trajectory:
    model = with_values(preset_model(name, "cell"), {"initial_soc": jnp.asarray(initial_soc)})
    return run_track(model, *padded(model, profile, ROWS, ROWS))


def test_every_file_is_listed_under_its_title() -> None:
    files = {path.stem for path in (REPOSITORY / "jaxmodel" / "case" / "presets").glob("*.toml")}
    assert files == set(MADE)
    assert {name: read_form(name).title for name in MADE} == {name: PRESETS[name] for name in MADE}


@pytest.mark.parametrize("name", MADE)
def test_every_number_has_a_source_and_every_file_its_licence(name: str) -> None:
    form = read_form(name)
    tables = [entry for _, entry in form.parameters if entry is not None]
    assert all(entry.source for entry in [*form.parameters.__pydantic_extra__.values(), *tables])
    assert form.licence
    assert form.data
    assert {entry.column for entry in form.held_out} <= set(KINDS[form.kinds[0]].outputs)
    assert len(form.held_out) > 0


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_brings_all_its_curves_and_they_are_a_cells(name: str) -> None:
    """The voltage at rest never falls as charge grows, and the series resistance falls as the cell warms."""
    tables = read_preset(name).tables
    assert set(tables) == {"ocv", "R_ints", "R_TS", "R_TL", "C_TS", "C_TL"}
    assert all(table.soc[0] < 0.03 and table.soc[-1] > 0.97 for table in tables.values())
    assert np.all(np.diff(tables["ocv"].values, axis=-1) > -5e-4)  # V: to its sd
    series = tables["R_ints"]
    middle = series.values[:, (series.soc > 0.3) & (series.soc < 0.8)].mean(axis=1)
    assert np.all(np.diff(middle) < 0.0)


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_runs_within_its_tables(name: str) -> None:
    """A discharge and a rest at each of its temperatures: finite, lower under load, back up at rest."""
    capacity = float(preset_model(name, "cell").parameters.capacity_Ah)
    temperatures = read_preset(name).tables["ocv"].temperature_degC
    temperatures = read_preset(name).tables["R_ints"].temperature_degC if temperatures is None else temperatures
    assert temperatures is not None
    current = np.where(np.arange(121) <= 80, 0.5 * capacity, 0.0)
    for degC in temperatures[[0, -1]]:
        ran = run_of_cell(name, Profile(np.arange(121) * 60.0, {"current_A": current, "ambient_degC": degC}))
        voltage = np.asarray(ran.readings["voltage_V"])[:121]
        assert np.all(np.isfinite(voltage))
        assert np.all(ran.valid)
        assert 1.5 < voltage[80] < voltage[120] < voltage[0] < 4.5


def test_a_cell_serves_a_robot_whose_other_parts_are_the_papers() -> None:
    model = preset_model("samsung_30q", "robot")
    assert float(model.parameters.k_tau) == float(preset_model("paper", "robot").parameters.k_tau)
    profile = constant(60.0, 10.0, duty=0.3, load_torque_Nm=0.1, ambient_degC=30.0)
    readings = run(model, profile).readings
    assert all(np.all(np.isfinite(values)) for values in readings.values())
    assert 6 * 3.5 < float(readings["pack_voltage_V"][6]) < 6 * 4.2


def test_a_motor_settles_where_its_equations_do(tmp_path: Path) -> None:
    head = 'title = "Ours"\nkinds = ["motor"]\ndata = "bench 7"\nlicence = "CC0"\n'
    (tmp_path / "ours.toml").write_text(f"{head}[parameters]\nR_0 = 2.8\nk_tau = 0.96\ntau_0 = 0.22\n", "utf-8")
    model = preset_model(str(tmp_path / "ours.toml"), "motor")
    p = model.parameters
    voltage, load = 6.0, 0.1
    profile = constant(1.0, 0.5, voltage_V=voltage, load_torque_Nm=load, ambient_degC=25.0)
    readings = run(model, profile).readings
    current = (float(p.tau_0) + load) / float(p.k_tau)
    speed = (voltage - float(p.R_0) * current) / float(p.k_tau)
    # The winding warms by some tenths of a kelvin in that second.
    assert float(readings["current_A"][2]) == pytest.approx(current, rel=1e-3)
    assert float(readings["speed_rad_s"][2]) == pytest.approx(speed, rel=5e-3)


@pytest.mark.parametrize("name", MADE)
def test_a_kind_that_it_does_not_serve_gets_one_sentence(name: str) -> None:
    with pytest.raises(ParameterError) as caught:
        case_model(case_with(name, other := "motor" if name in CELLS else "cell"))
    assert str(caught.value).startswith(f"bench/case.toml: preset '{name}' ({PRESETS[name]}) serves kind ")
    assert f"not '{other}'" in str(caught.value)


def test_a_misspelt_preset_is_told_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"no preset is called 'samsung30q'\. Did you mean 'samsung_30q'\?"):
        preset_model("samsung30q", "cell")


def test_a_case_wins_over_its_preset() -> None:
    ocv = Table(np.array([0.0, 1.0]), np.array([3.0, 4.0]))
    own = case_with("samsung_30q", "cell", parameters={"capacity_Ah": Known(2.5)}, tables={"ocv": ocv})
    ours, theirs = case_model(own), preset_model("samsung_30q", "cell")
    assert float(ours.parameters.capacity_Ah) == 2.5
    assert float(ours.curves.ocv(jnp.asarray(0.5), jnp.asarray(20.0))) == 3.5
    np.testing.assert_array_equal(jax.tree.leaves(ours.curves.R_ints)[1], jax.tree.leaves(theirs.curves.R_ints)[1])


def test_a_case_from_disk_takes_values_and_uncertainty(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("time_s,current_A,ambient_degC,voltage_V\n0,0,20,4.1\n1,1,20,4.0\n", "utf-8")
    (tmp_path / "case.toml").write_text(
        textwrap.dedent("""
        kind = "cell"
        preset = "lg_mj1"
        [parameters]
        series_resistance_scale = 1.1
        [[runs]]
        file = "run.csv"
        split = "fit"
        """),
        "utf-8",
    )
    case, preset = read_case(tmp_path), read_preset("lg_mj1")
    assert case.parameters["capacity_Ah"] == preset.parameters["capacity_Ah"]
    assert case.parameters["capacity_Ah"].sd is not None
    assert case.parameters["series_resistance_scale"] == Known(1.1)  # known exactly: the preset's sd goes too
    assert case.tables["ocv"] is preset.tables["ocv"]


def file_of(folder: Path, capacity_Ah: float = 2.5) -> Path:
    folder.mkdir(exist_ok=True)
    head = 'title = "Ours"\nkinds = ["cell"]\ndata = "bench 7"\nlicence = "CC0"\n'
    text = f"{head}[parameters]\ncapacity_Ah = {capacity_Ah}\n"
    (folder / "ours.toml").write_text(text, "utf-8")
    return folder / "ours.toml"


def case_naming(folder: Path, preset: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "run.csv").write_text("time_s,current_A,ambient_degC,voltage_V\n0,0,20,4.1\n1,1,20,4.0\n", "utf-8")
    text = f'kind = "cell"\npreset = "{preset}"\n[[runs]]\nfile = "run.csv"\nsplit = "fit"\n'
    (folder / "case.toml").write_text(text, "utf-8")
    return folder


def test_a_preset_may_be_a_file_beside_the_case(tmp_path: Path) -> None:
    file_of(tmp_path)
    case = read_case(case_naming(tmp_path / "case", "../ours.toml"))
    assert case.parameters["capacity_Ah"] == Known(2.5)
    assert float(case_model(case).parameters.capacity_Ah) == 2.5
    file_of(tmp_path, 2.6)  # a file may change, and a preset of the package does not
    assert read_case(tmp_path / "case").parameters["capacity_Ah"] == Known(2.6)
    written = tmp_path / "elsewhere" / "deeper"
    case.write(written)
    assert 'preset = "../../ours.toml"' in (written / "case.toml").read_text("utf-8")
    assert read_case(written).preset == case.preset


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (None, "there is no preset file 'ours.toml'"),
        (("title", "titel"), "preset 'ours.toml': the file knows no 'titel'. Did you mean 'title'?"),
        (("capacity_Ah = 2.5", "capacity_Ah = -1"), "capacity_Ah"),
        (("[parameters]", "[parameters"), "preset 'ours.toml', line 5"),
        (('"cell"', '"motor"'), "preset 'ours.toml' (Ours) serves kind motor, not 'cell'"),
    ],
)
def test_a_file_that_is_no_preset_gets_one_sentence(tmp_path: Path, change: tuple[str, str] | None, says: str) -> None:
    file = file_of(tmp_path)
    if change is None:
        file.unlink()
    else:
        file.write_text(file.read_text("utf-8").replace(*change), "utf-8")
    case = read_case(case_naming(tmp_path / "case", "../ours.toml"))
    with pytest.raises(ParameterError) as caught:
        case_model(case)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("kind", "sentence"), [("cell", ""), ("motor", "serves kind cell and robot, not 'motor'")])
def test_a_study_takes_a_preset(tmp_path: Path, kind: str, sentence: str) -> None:
    (tmp_path / "study.toml").write_text(
        textwrap.dedent(f"""
        kind = "{kind}"
        preset = "k2_lfp_26650"
        [profile]
        duration_s = 100
        step_s = 10
        current_A = 2.0
        [axes]
        ambient_degC = [20.0, 40.0]
        """),
        "utf-8",
    )
    if sentence:
        with pytest.raises(SweepError, match=sentence):
            read_study(tmp_path / "study.toml")
    else:
        model = read_study(tmp_path / "study.toml").prepared.model
        assert float(model.parameters.capacity_Ah) == read_preset("k2_lfp_26650").parameters["capacity_Ah"].value


def test_the_papers_preset_opens_no_file() -> None:
    code = """
        import sys
        opened = []
        sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
        from jaxmodel.case.build import preset_model
        preset_model("paper", "robot")
        sys.exit(any(name.endswith(".toml") for name in opened))
    """
    assert subprocess.run([sys.executable, "-c", textwrap.dedent(code)], cwd=REPOSITORY, check=False).returncode == 0


@needs_data
@pytest.mark.parametrize("name", HELD_OUT)
def test_a_preset_is_as_good_as_documented_on_a_run_held_out(name: str) -> None:
    file, of_run, options = HELD_OUT[name]
    imported = import_case(DATA / file, "cell", preset=name, initial_soc=1.0, **options)
    # The capacity is that of the preset, and not of this run.
    (ran,) = simulate_case(dataclasses.replace(imported.case, parameters=read_preset(name).parameters))
    error = ran.table["voltage_V"].to_numpy() - ran.run.measured.outputs["voltage_V"]
    assert np.sqrt(np.nanmean(error**2)) == pytest.approx(figure(name, of_run), rel=0.03)


def test_the_page_prints_every_figure() -> None:
    page = (REPOSITORY / "docs" / "presets.md").read_text(encoding="utf-8")
    for name in MADE:
        assert f"| `{name}` | {PRESETS[name]} | {read_form(name).licence} |" in page
        for entry in read_form(name).held_out:
            scale, unit = UNITS[entry.column]
            assert f"| `{name}` | {entry.run} | {scale * entry.rms:.3g} {unit} |" in page
