from __future__ import annotations

import runpy
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from jaxmodel.base.errors import UserError
from jaxmodel.sweeps import Study, read_study, run

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


def test_case_gives_its_initial_state_of_charge(tmp_path):
    """A case has it for its runs; a study made from the case starts there too, unless it says otherwise."""
    (tmp_path / "run.csv").write_text("time_s,current_A,voltage_V\n0,0,4\n10,1,3.9\n")
    (tmp_path / "case.toml").write_text(
        'kind = "cell"\n[parameters]\ninitial_soc = { value = 0.6, sd = 0.01 }\n'
        '[[runs]]\nfile = "run.csv"\nsplit = "fit"\nambient_degC = 20\n'
    )
    text = 'case = "case.toml"\n{}[profile]\ncsv = "run.csv"\nambient_degC = 20\n[axes]\ncycles = [0]\n'
    for stated, expected in (("", 0.6), ("[parameters]\ninitial_soc = 0.9\n", 0.9)):
        study = read(tmp_path, text.format(stated))
        assert float(study.prepared.model.parameters.initial_soc) == expected


def test_axes_are_spaced_as_said(tmp_path):
    steps = read(tmp_path, STUDY.replace("[0, 100]", "{ start = 0, stop = 0.3, step = 0.1 }")).axes["cycles"]
    np.testing.assert_allclose(steps, [0.0, 0.1, 0.2, 0.3], rtol=1e-15)
    down = read(tmp_path, STUDY.replace("[0, 100]", "{ start = 5, stop = 2, step = 2 }")).axes["cycles"]
    assert down == [5.0, 3.0]
    decades = read(tmp_path, STUDY.replace("[0, 100]", '{ start = 1, stop = 100, count = 3, spacing = "log" }'))
    np.testing.assert_allclose(decades.axes["cycles"], [1.0, 10.0, 100.0], rtol=1e-15)


SAMPLE = """
[sample]
method = "{}"
count = 256
seed = 3
[sample.ranges]
capacity_Ah = [2.0, 4.0]
R_0 = {{ low = 0.01, high = 1.0, spacing = "log" }}
"""


@pytest.mark.parametrize("method", ["sobol", "latin_hypercube", "random"])
def test_sample_fills_its_ranges_and_any_part_is_drawn_alone(tmp_path, method: str):
    study = read(tmp_path, STUDY + SAMPLE.format(method))
    assert study.dims == {"ambient_degC": 5, "cycles": 2, "lane": 256}
    whole = study.drawn(np.arange(256))
    for order in (range(0, 256, 32), reversed(range(0, 256, 32))):
        for first in order:
            part = study.drawn(np.arange(first, first + 32))
            for name in whole:
                np.testing.assert_array_equal(part[name], whole[name][first : first + 32])
    other = read(tmp_path, STUDY + SAMPLE.format(method).replace("seed = 3", "seed = 0")).drawn(np.arange(256))
    assert not np.any(other["capacity_Ah"] == whole["capacity_Ah"])
    share = (whole["capacity_Ah"] - 2.0) / 2.0, np.log10(whole["R_0"] / 0.01) / 2.0
    # In sixteenths of each range: both designs are even there, a random one is within four standard deviations.
    for values in share:
        found = np.histogram(values, 16, (0.0, 1.0))[0]
        assert found.sum() == 256
        assert np.all(found == 16) if method != "random" else np.all(np.abs(found - 16) <= 16)
    lanes = study.lanes(np.array([256 * 3 + 7]))  # the sample runs fastest
    assert (lanes["ambient_degC"][0], lanes["cycles"][0]) == (10.0, 100.0)
    assert lanes["R_0"][0] == whole["R_0"][7]


def robot(profile: dict, **axes: list[float]) -> Study:
    return Study(kind="robot", profile={"ambient_degC": 20.0, **profile}, axes={"cycles": [0.0]} | axes)


def test_pulses_are_on_for_their_time_of_each_period():
    train = {"high": 0.5, "low": 0.1, "on_s": 4, "period_s": 10, "start_s": 6}
    profile = robot({"duration_s": 30, "step_s": 2, "load_torque_Nm": 0.1, "pulses": {"duty": train}}).prepared.profile
    held_over = profile.time_s[1:] - 1.0  # the middle of what each row holds over
    on = ((held_over > 6) & (held_over < 10)) | ((held_over > 16) & (held_over < 20)) | (held_over > 26)
    np.testing.assert_array_equal(profile.inputs["duty"][1:], np.where(on, 0.5, 0.1))


def test_cycle_is_scaled_and_goes_on_where_it_ended(tmp_path):
    (tmp_path / "cycle.csv").write_text("time_s,duty,load_torque_Nm\n5,0.9,0\n6,0.1,0.1\n8,0.2,0.2\n")
    fields = {"csv": str(tmp_path / "cycle.csv"), "repeat": 3, "scale": {"load_torque_Nm": 2.0}}
    profile = robot(fields).prepared.profile
    np.testing.assert_array_equal(profile.time_s, [5, 6, 8, 9, 11, 12, 14])
    np.testing.assert_array_equal(profile.inputs["duty"], [0.9, 0.1, 0.2, 0.1, 0.2, 0.1, 0.2])
    np.testing.assert_array_equal(profile.inputs["load_torque_Nm"], [0.0, 0.2, 0.4, 0.2, 0.4, 0.2, 0.4])


def test_mission_drives_at_its_speeds(tmp_path):
    """The duty of eq. 14 holds the speed at the nominal voltage: v = w r / G in equilibrium."""
    text = """
kind = "robot"
store = ["speed_rad_s", "pack_voltage_V"]
[parameters]
psi_R = 0.0
[profile]
ambient_degC = 20
[[profile.mission]]
duration_s = 20
incline_deg = 5
speed_m_s = 0.2
[[profile.mission]]
duration_s = 10
incline_deg = 0
speed_m_s = -0.1
[[profile.mission]]
duration_s = 10
incline_deg = -40
speed_m_s = 0
[axes]
cycles = [0]
"""
    study = read(tmp_path, text)
    inputs = study.prepared.profile.inputs
    np.testing.assert_array_equal(inputs["incline_deg"], np.repeat([5.0, 0.0, -40.0], [21, 10, 10]))
    assert inputs["duty"][-1] == 0.0
    result = run(study).isel(cycles=0)
    model = study.prepared.model
    for row, speed_m_s in ((20, 0.2), (30, -0.1)):
        # The back-EMF takes what the true pack voltage gives beyond the nominal one; that falls 1e-5 of itself a step.
        more = float(inputs["duty"][row] * (result.pack_voltage_V[row] - 6 * 3.8) / model.parameters.k_tau)
        np.testing.assert_allclose(result.speed_rad_s[row] - more, speed_m_s * 156.0 / 0.1, rtol=1e-5)


def test_inputs_are_scaled_and_states_begin_lane_by_lane(cell_study):
    """A factor on the current is that current; an RC pair that begins charged lowers the first voltage by as much."""
    fixed = cell_study(axes={"current_A": [0.5, 1.0, 2.0]})
    profile = fixed.profile.model_dump() | {"current_A": 2.0}
    scaled = run(cell_study(profile=profile, axes={"scale.current_A": [0.25, 0.5, 1.0]}))
    for name in ("soc_gradient", "delivered_charge_Ah", "min_voltage_V"):
        np.testing.assert_array_equal(scaled[name].values, run(fixed)[name].values)
    assert scaled["scale.current_A"].attrs["long_name"] == "factor on the input current_A"
    begun = run(cell_study(profile=profile, axes={"initial.v_ts_V": [0.0, 0.1]}, store=["voltage_V"]))
    np.testing.assert_allclose(np.diff(begun["voltage_V"].isel(time_s=0)), -0.1, rtol=1e-12)
    assert begun["initial.v_ts_V"].attrs["units"] == "V"
    half = run(cell_study(profile=profile, axes={"initial.soc": [0.5]}, metrics=["final_soc"]))
    full = run(cell_study(profile=profile, axes={"initial.soc": [1.0]}, metrics=["final_soc"]))
    np.testing.assert_allclose(full.final_soc.values - half.final_soc.values, 0.5, rtol=1e-12)


def test_sampled_lanes_are_those_of_the_same_values(cell_study, tmp_path):
    sample = {"count": 100, "method": "sobol", "ranges": {"current_A": [0.5, 2.0], "capacity_Ah": [2.0, 4.0]}}
    study = cell_study(axes={"cycles": [0.0, 50.0]}, sample=sample)
    result = run(study, out=tmp_path / "out")
    assert result["soc_gradient"].dims == ("cycles", "lane")
    assert result["current_A"].dims == ("lane",)
    xr.testing.assert_equal(result.load(), run(study))
    usable = -result["current_A"] / result["soc_gradient"] / 3600.0  # closed form: i / Q
    share = usable / result["capacity_Ah"]
    np.testing.assert_allclose(share, float(share[0, 0]), rtol=1e-12)
    lane = {name: [float(result[name][42])] for name in ("current_A", "capacity_Ah")}
    alone = run(cell_study(axes={"cycles": [0.0, 50.0], **lane}))
    np.testing.assert_allclose(alone.min_voltage_V.values.ravel(), result.min_voltage_V[:, 42], rtol=1e-12)


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
    "axis of text": ("[0, 100]", '["many"]', 'axes.cycles[1] must be a number, without quotes, not "many".'),
    "axis of one number": ("[0, 100]", "100", "axes.cycles must be a list of numbers, or { start = ..."),
    "axis half spaced": (", count = 5", "", "axes.ambient_degC needs either count or step, one of them."),
    "name with a dot and no quotes": (
        "cycles =",
        "slow_diffusion.R_3 =",
        'axes has a name with a dot and no quotes around it; write "slow_diffusion.R_3" = ...',
    ),
    "parameter with a dot and no quotes": (
        "[axes]",
        "[parameters]\nslow_diffusion.R_3 = 0.01\n[axes]",
        'parameters has a name with a dot and no quotes around it; write "slow_diffusion.R_3" = ...',
    ),
    "logarithm of zero": (
        "start = 0,",
        'start = 0, spacing = "log",',
        'axes.ambient_degC has spacing = "log", which takes',
    ),
    "scale of no input": ("cycles =", '"scale.current_A" =', "axes.scale.current_A: the profile has no input"),
    "scale of a temperature": ("cycles =", '"scale.ambient_degC" =', "a temperature in degC has no factor"),
    "scale beyond a duty": ("cycles = [0, 100]", '"scale.duty" = [1, 4]', "axes.scale.duty: 1.2 is outside -1 to 1"),
    "unknown state": ("cycles =", '"initial.socs" =', "the model has no state 'socs'. Did you mean 'soc'?"),
    "sample of an axis": (
        "[axes]",
        "[sample]\ncount = 4\nranges = { cycles = [0, 1] }\n[axes]",
        "the study has 'cycles' under [axes] and under [sample.ranges]",
    ),
    "sample of nothing": (
        "[axes]",
        "[sample]\ncount = 4\nranges = {}\n[axes]",
        "sample.ranges must not be empty.",
    ),
    "sample backwards": (
        "[axes]",
        "[sample]\ncount = 4\nranges = { capacity_Ah = [3, 2] }\n[axes]",
        "sample.ranges.capacity_Ah has low = 3.0 and high = 2.0; low must be less.",
    ),
    "sample out of bounds": (
        "[axes]",
        "[sample]\ncount = 4\nranges = { capacity_Ah = [-1, 2] }\n[axes]",
        "sample.ranges.capacity_Ah: 'capacity_Ah' = -1 is outside",
    ),
    "sample of things counted": (
        "[axes]",
        "[sample]\ncount = 4\nranges = { n_motors = [2, 4] }\n[axes]",
        "n_motors takes whole numbers; put it on an axis instead.",
    ),
    "axis that goes nowhere": ("start = 0,", "start = 40,", "has a value twice"),
    "duration repeated": ("duration_s = 60", "duration_s = 60\nrepeat = 3", "profile has repeat and duration_s"),
    "pulse between rows": (
        "duty = 0.3",
        "pulses.duty = { high = 0.5, on_s = 2.5, period_s = 10 }",
        "profile has pulses.duty.on_s = 2.5 and step_s = 1.0; each time of a pulse must be a whole number of steps",
    ),
    "segment without an input": (
        "duration_s = 60\nduty = 0.3",
        "mission = [{ duration_s = 5, duty = 0.1 }, { duration_s = 5 }]",
        "profile.mission[2]: 'duty' is given in one segment and not in another; give it in each.",
    ),
    "speed beyond the voltage": (
        "duration_s = 60\nduty = 0.3",
        "mission = [{ duration_s = 5, speed_m_s = 9.0 }]",
        "profile.mission[1]: 9 m/s takes a duty of 23.",
    ),
    "no axes": (
        STUDY[STUDY.index("[axes]") :],
        "[axes]",
        "the study varies nothing; add [axes] with at least one name, or a [sample].",
    ),
    "unknown kind": (ROBOT, 'kind = "rover"', 'kind must be "cell", "motor" or "robot", not "rover".'),
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
        "profile needs one of duration_s (with constant inputs), csv and mission.",
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
    "time to no cut-off": (
        ROBOT,
        f'{ROBOT}\ncutoff = {{}}\nmetrics = ["time_to_cutoff_s"]',
        "needs a [cutoff] with soc or voltage_V",
    ),
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
    assert text.startswith((f"{tmp_path.name}/study.toml: ", f"{tmp_path.name}/study.toml, line "))
    assert text.endswith((".", "?"))
    assert "\n" not in text


def test_column_in_which_lanes_differ_is_not_stored_again(tmp_path):
    motor = """kind = "motor"
store = ["current_A"]
[profile]
duration_s = 60
load_torque_Nm = 0.1
ambient_degC = 20
[axes]
current_A = [2.0, 4.0]
"""
    with pytest.raises(UserError, match="store: lanes differ in 'current_A', which is a coordinate"):
        read(tmp_path, motor)


def test_factor_is_checked_on_every_value_of_an_axis(tmp_path):
    text = STUDY.replace("duty = 0.3\n", "").replace("cycles = [0, 100]", 'duty = [0.3, 0.6]\n"scale.duty" = [1, 2]')
    with pytest.raises(UserError, match=r"axes\.scale\.duty: 1\.2 is outside -1 to 1"):
        read(tmp_path, text)
