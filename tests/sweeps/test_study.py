from __future__ import annotations

import runpy
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.errors import UserError
from sweeps import Study, read_study

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDY = """
kind = "robot"
[profile]
duration_s = 60
duty = 0.3
load_torque_Nm = 0.1
[axes]
ambient_degC = { start = 0, stop = 40, count = 5 }
cycles = [0, 100]
"""


def read(folder: Path, text: str) -> Study:
    path = folder / "study.toml"
    path.write_text(text)
    return read_study(path)


def test_paper_sweep_is_the_grid_of_the_paper():
    study = read_study(EXAMPLES / "paper_sweep.toml")
    assert study.shape == (7, 8, 9, 9)
    assert study.size == 4536
    assert study.axes["ambient_degC"] == [-20, 0, 20, 40, 60, 80, 100]
    assert {0.175, 0.25, 0.3, 0.35} <= set(study.axes["load_torque_Nm"])
    assert study.prepared.profile.time_s.size == 1801


def test_python_and_toml_say_the_same():
    written = runpy.run_path(str(EXAMPLES / "paper_sweep.py"))["study"]
    assert written.digest == read_study(EXAMPLES / "paper_sweep.toml").digest


def test_lanes_run_through_the_grid_in_the_order_of_the_axes(tmp_path):
    study = read(tmp_path, STUDY)
    lanes = study.lanes(np.arange(study.size))
    expected = [(t, n) for t in (0, 10, 20, 30, 40) for n in (0, 100)]
    assert list(zip(lanes["ambient_degC"], lanes["cycles"], strict=True)) == expected


def test_digest_tells_studies_and_their_files_apart(tmp_path):
    csv = "time_s,duty,load_torque_Nm\n0,0.3,0.1\n60,0.3,{}\n"
    text = STUDY.replace("duration_s = 60\nduty = 0.3\nload_torque_Nm = 0.1", 'csv = "drive.csv"')
    digests = set()
    for torque in (0.1, 0.2):
        (tmp_path / "drive.csv").write_text(csv.format(torque))
        digests |= {read(tmp_path, text).digest, read(tmp_path, text.replace("100]", "200]")).digest}
    assert len(digests) == 4


def test_csv_inputs_are_replaced_by_axes(tmp_path):
    (tmp_path / "drive.csv").write_text("time_s,V_set,load_torque_Nm\n0,2.5,0.1\n60,3.25,0.2\n")
    text = STUDY.replace("duration_s = 60\nduty = 0.3\nload_torque_Nm = 0.1", 'csv = "drive.csv"')
    profile = read(tmp_path, text).prepared.profile
    np.testing.assert_allclose(profile.inputs["duty"], [0.0, 0.3])
    np.testing.assert_array_equal(profile.inputs["load_torque_Nm"], [0.1, 0.2])
    np.testing.assert_array_equal(profile.inputs["ambient_degC"], [0.0, 0.0])
    replaced = read(tmp_path, text.replace("cycles =", "duty = [0.4]\nload_torque_Nm = [0.3]\ncycles ="))
    np.testing.assert_array_equal(replaced.prepared.profile.inputs["duty"], [0.4, 0.4])


def test_case_brings_the_hardware(tmp_path):
    (tmp_path / "run.csv").write_text("time_s,current_A,voltage_V\n0,0,4\n10,1,3.9\n")
    (tmp_path / "case.toml").write_text(
        'kind = "cell"\ncutoff = { soc = 0.2 }\n[parameters]\ncapacity_Ah = 3.0\n'
        "ocv = { soc = [0, 1], voltage_V = [3, 4] }\n[effects]\n"
        'voltage_offset = { column = "voltage_V", c = 0.1 }\ncharge_transfer = { i_0 = 2.0 }\n'
        '[[runs]]\nfile = "run.csv"\nsplit = "fit"\nambient_degC = 20\n'
    )
    text = (
        'case = "case.toml"\n[profile]\ncsv = "run.csv"\n[axes]\n"charge_transfer.i_0" = [1, 2]\nambient_degC = [0]\n'
    )
    study = read(tmp_path, text)
    model, cutoff = study.prepared.model, study.prepared.cutoff
    assert model.kind == "cell"
    assert float(model.parameters.capacity_Ah) == 3.0
    assert float(model.curves.ocv(jnp.asarray(0.5), jnp.asarray(20.0))) == 3.5
    assert [effect.name for effect in model.effects] == ["charge_transfer"]  # a sweep has no sensors
    assert cutoff is not None
    assert cutoff.soc == 0.2


ROBOT = 'kind = "robot"'
WRONG = {
    "unknown key": ("[axes]", "[axis]", "study.toml: the study knows no 'axis'. Did you mean 'axes'?"),
    "unknown axis": (
        "cycles =",
        "cycle =",
        "axes.cycle: no parameter, and no input of a robot, is called 'cycle'.",
    ),
    "axis of an effect that is off": (
        "cycles =",
        '"ocv_hysteresis.M_V" =',
        "the effect 'ocv_hysteresis' is off; turn it on",
    ),
    "axis out of bounds": ("[0, 100]", "[0, -1]", "axes.cycles: 'cycles' = -1 is outside its range 0 to 100000"),
    "axis in percent": ("cycles = [0, 100]", "duty = [30]", "axes.duty: 30 is outside -1 to 1"),
    "axis with a value twice": ("[0, 100]", "[0, 100, 0]", "axes.cycles has a value twice"),
    "axis without values": ("[0, 100]", "[]", "axes.cycles is empty; give it at least one value."),
    "axis of text": ("[0, 100]", '["many"]', 'axes.cycles[1] should be a valid number, not "many".'),
    "axis of one number": ("[0, 100]", "100", "axes.cycles must be a list of numbers, or { start = ..."),
    "axis half spaced": (", count = 5", "", "axes.ambient_degC.count is missing; add it."),
    "no axes": (STUDY[STUDY.index("[axes]") :], "[axes]", "axes must not be empty."),
    "unknown kind": (ROBOT, 'kind = "rover"', "kind should be 'cell', 'motor' or 'robot', not \"rover\"."),
    "no kind": (ROBOT, "", "kind is missing; add kind ="),
    "unknown preset": (ROBOT, f'{ROBOT}\npreset = "papr"', "no preset is called 'papr'. Did you mean 'paper'?"),
    "unknown parameter": (
        "[axes]",
        "[parameters]\nk_ta = 1\n[axes]",
        "parameters.k_ta: no parameter is called 'k_ta'.",
    ),
    "unknown effect": (
        "[axes]",
        "[effects]\nhysteresis = {}\n[axes]",
        "no effect is called 'hysteresis'. Did",
    ),
    "effect of a sensor": (
        "[axes]",
        "[effects]\nclock_shift = { d = 1.0 }\n[axes]",
        "effects.clock_shift: a sweep",
    ),
    "no duration": (
        "duration_s = 60",
        "",
        "profile needs either duration_s (with constant inputs) or csv",
    ),
    "ragged duration": (
        "duration_s = 60",
        "duration_s = 60\nstep_s = 7",
        "profile has duration_s = 60.0 and",
    ),
    "unknown input": (
        "load_torque_Nm",
        "load_torqe_Nm",
        "profile.load_torqe_Nm: a robot has no input",
    ),
    "missing input": ("ambient_degC =", "initial_soc = [1]\n#", "needs the input 'ambient_degC'"),
    "input twice": ("duty = 0.3", "duty = 0.3\nV_set = 3", "takes one, not both, of the inputs duty and V_set"),
    "unknown metric": (ROBOT, f'{ROBOT}\nmetrics = ["soc_gradiant"]', "a robot has no metric 'soc_gradiant'. Did"),
    "time to no cut-off": (ROBOT, f'{ROBOT}\nmetrics = ["time_to_cutoff_s"]', "needs a [cutoff] with soc or voltage_V"),
    "metric of another kind": (
        ROBOT,
        f'{ROBOT}\nmetrics = ["min_voltage_V"]',
        "no metric 'min_voltage_V'. Did you",
    ),
    "unknown column": (ROBOT, f'{ROBOT}\nstore = ["socs"]', "store: a robot has no column 'socs'. Did you mean 'soc'?"),
    "no such CSV": ("duration_s = 60", 'csv = "none.csv"', "cannot be read"),
    "not TOML": ("[axes]", "[axes", "this is not valid TOML"),
}


@pytest.mark.parametrize(("old", "new", "message"), WRONG.values(), ids=WRONG)
def test_mistake_is_told_in_one_sentence(tmp_path, old: str, new: str, message: str):
    assert old in STUDY
    with pytest.raises(UserError) as caught:
        read(tmp_path, STUDY.replace(old, new, 1))
    text = str(caught.value)
    assert message in text
    assert text.startswith(f"{tmp_path.name}/study.toml: ")
    assert text.endswith((".", "?"))
    assert "\n" not in text
