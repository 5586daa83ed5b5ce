"""Make every preset of jaxmodel/presets from measured data: `python make_presets.py SOURCE_FOLDER [NAME ...]`.

SOURCE_FOLDER holds one folder for each data set, named in `CELLS` and `MOTORS`; README.md beside this script says what
each is. The figures of runs held out are of the product's own simulation of the file just written.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
from cells import Fit, Plan, Rows, Test, fit, read, scale
from motors import Estimates, brake_points, estimate, lift_points

import jaxmodel.presets
from jaxmodel.build import make_effect, preset_model
from jaxmodel.names import with_values
from jaxmodel.presets import PRESETS, read_preset
from jaxmodel.profile import Profile, constant
from jaxmodel.simulation import simulate

FOLDER = Path(jaxmodel.presets.__file__).parent
LEAST_SD = 0.02  # of a scale: two cells are never more similar than this
STANDING = 0.1  # below this current in A the first row of a run is at rest and gives the state of charge

OCV_SOC = (0.0, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.275, 0.3, 0.35, 0.4, 0.45)
OCV_SOC += (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.825, 0.85, 0.875, 0.9, 0.925, 0.95, 0.975, 0.99, 1.0)
SERIES_SOC = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)
PAIR_SOC = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
FINER_SOC = tuple(np.round(np.interp(np.arange(0, 6.1, 1 / 3), range(7), PAIR_SOC), 4).tolist())
ARTS = "ARTS-Lab, University of South Carolina, GitHub ARTS-Laboratory/"
UNTOLD = (
    "not identified: rc_capacitance_scale's uncertainty. 0.0005 ohm in a table is none: the fit wanted nothing there."
)


@dataclasses.dataclass(frozen=True)
class Cell:
    """One cell: data, how its curves are fitted, and check runs, each with the chamber temperature in degC."""

    data: str
    licence: str
    plan: Plan
    made_from: str
    held_out: tuple[tuple[str, float], ...]
    capacity_sd: tuple[float, str]
    notes: tuple[str, ...]
    self_heating: dict[str, float] | None = None


def plan(folder: str, tests: tuple[Test, ...], empties: str, degC: tuple[float, ...], hot=None, lowest=0.05) -> Plan:
    """Return a plan with the points that all cells share; `lowest` is the first of the series resistance."""
    series = tuple(soc for soc in SERIES_SOC if soc >= lowest)
    return Plan(folder, tests, empties, degC, OCV_SOC, series, PAIR_SOC, (15.0, 300.0), hot)


CELLS = {
    "samsung_30q": Cell(
        data=ARTS + "dataset-electrothermal-deformation-characterization-for-samsung-30Q-cell, commit 4e9effdf",
        licence="CC BY-SA 4.0",
        plan=plan(
            "samsung_30q_18650",
            (
                Test("cell1_c10_slow.csv", weight=3.0, own_ocv=False),
                *(Test(f"cell1_hppc_{rate}_p{T}degC.csv", least_V=3.0) for T in (20, 40) for rate in ("1C", "2C")),
                *(Test(f"cell1_cc{rate}C.csv", least_V=2.55, own_ocv=False) for rate in (1, 3)),
            ),
            "cell1_c10_slow.csv",
            (20.6, 40.0),
            hot=55.0,
            lowest=0.15,  # below it no pulse is fitted
        ),
        made_from="cell 1: C/10, pulses of 1C and 2C at 20 and 40 degC, discharges at 1C and 3C",
        held_out=(
            ("cell1_cc2C.csv", 23.0),
            ("cell1_cc4C.csv", 23.0),
            ("cell2_cc1C.csv", 23.0),
            ("cell2_cc4C.csv", 23.0),
        ),
        capacity_sd=(0.03, "1 %: cells 1 and 2 agree to that, and it allows for the current sensor's gain"),
        notes=(
            "SOC 1 is about 4.16 V at rest, SOC 0 the end of C/10 at 2.5 V.",
            "The cell warms by 11 (1C) to 41 K (4C): without self_heating the model is a cold cell's.",
            "Turn it on: [effects] self_heating = { C_th = 85, hA = 0.053 } (from examples/samsung_30q).",
            "At 55 degC all resistances are one fitted factor times those at 40 degC: only discharges go there.",
            "not identified: the cold; below 20.6 degC the tables are held.",
        ),
        self_heating={"C_th": 85.0, "hA": 0.053},
    ),
    "lg_mj1": Cell(
        data=ARTS + "dataset-LG-MJ1-INR-18650-cell-characterization, commit 60490059",
        licence="CC BY-SA 4.0",
        plan=plan(
            "lg_mj1_18650",
            tuple(
                test
                for T in (20, 40)
                for test in (
                    Test(f"pulse_10pctSOC_p{T}degC.csv", 1.0, own_ocv=T == 40),
                    Test(
                        f"pulse_5pctSOC_p{T}degC.csv",
                        follows=f"pulse_10pctSOC_p{T}degC.csv",
                        least_V=2.5,
                        own_ocv=T == 40,
                    ),
                )
            ),
            "pulse_5pctSOC_p40degC.csv",
            (20.0, 40.0),
        ),
        made_from="pulse tests at 20 and 40 degC: 12 s of 6 A either way, steps of 3 A, rests of 90 to 120 min",
        held_out=(("pulse_10pctSOC_p28degC.csv", 28.3),),
        capacity_sd=(0.04, "the tests at 20, 28 and 40 degC differ by 0.04 A h"),
        notes=(
            "SOC 1 is 4.15 V at rest, where the tests begin; SOC 0 is 2.5 V under 3 A at 40 degC.",
            "This cell gave 2.9 A h, not the 3.5 A h of its name. No discharge without rests is in the data.",
            "not identified: the cold; below 20 degC the tables are held.",
        ),
    ),
    "k2_lfp_26650": Cell(
        data=ARTS + "dataset-K2-26650-cell-characterization, commit 682baaae",
        licence="CC BY-SA 4.0",
        plan=plan(
            "k2_lfp_26650",
            (
                # The first charge pulse, into a full cell, is no resistance: 400 s are run through, not fitted.
                *(Test(f"hppc_p{T}degC.csv", least_V=2.0, from_s=400.0, own_ocv=T != 20) for T in (20, 30, 50)),
                *(Test(f"cc1C_p{T}degC.csv", 1.0, own_ocv=False) for T in (20, 50)),
            ),
            "cc1C_p50degC.csv",
            (20.5, 31.0, 50.0),
        ),
        made_from="pulse tests at 20, 30 and 50 degC, discharges at 1C at 20 and 50 degC",
        held_out=(("cc1C_p30degC.csv", 31.0),),
        capacity_sd=(0.02, "1C discharges at 20, 30 and 50 degC gave 2.20 to 2.23 A h"),
        notes=(
            "SOC 1 is full charge, SOC 0 the end of 1C at 50 degC at 2.5 V.",
            "Hysteresis is not in it: ocv is that of discharge.",
            "not identified: the cold; below 20.5 degC the tables are held.",
        ),
    ),
    "panasonic_18650pf": Cell(
        data="P. Kollmeyer, Panasonic 18650PF Li-ion Battery Data, Mendeley Data v1, DOI 10.17632/wykht8y7tg.1; "
        "copy GitHub fededc88/Panasonic-18650PF-Data, commit 6d720489",
        licence="not verified (the copy states none; cite the DOI)",
        plan=plan(
            "panasonic_18650pf",
            (
                Test("c20_ocv_p25degC.csv", 1.0, least_V=2.5, weight=3.0, own_ocv=False),
                *(Test(f"hppc_{T}degC.csv", least_V=2.45) for T in ("n20", "p00", "p10", "p25")),
                *(Test(f"drive_nn_{T}degC.csv", least_V=2.45) for T in ("n20", "p00", "p10", "p25")),
            ),
            "c20_ocv_p25degC.csv",
            (-20.0, 0.0, 10.0, 25.0),
        ),
        made_from="C/20 at 25 degC; pulse tests and the drive cycle NN at -20, 0, 10 and 25 degC",
        held_out=(
            *(
                (f"drive_us06_{T}degC.csv", degC)
                for T, degC in (("p25", 25.0), ("p10", 10.0), ("p00", 0.0), ("n20", -20.0))
            ),
            ("drive_cycle1_p25degC.csv", 25.0),
            ("cc1C_p25degC_start1.csv", 25.0),
        ),
        capacity_sd=(0.15, "the cell lost 13 % of its 1C capacity over the programme: half of the 0.36 A h, rounded"),
        notes=(
            "SOC 1 is 4.18 V at rest, SOC 0 the end of C/20 at 2.5 V.",
            "In the cold the cell heats itself by several kelvin: use its own temperature, or self_heating.",
            "Age and cold are partly confounded: the cold tests came last.",
        ),
    ),
}

GEAR = "The base model has no gear loss, and takes load too lightly: add [effects] gear_loss = { e = EEE }."
MOTORS = {
    "hobby_servo_s3315d": (
        "S. Pfrommer, GitHub spfrommer/servo-experiment, commit 8d48684b, folder processed",
        "none stated: numbers fitted to the data, none of the data",
        "hobby_servo_lift",
        lift_points,
        (0.1, 0.3, 0.6),
        "lifts of 0 to 750 g on a 0.10 m wheel at 7.15 V, without those of {held}",
        (
            "Gear included: torque and speed are the output shaft's. One lift at full voltage; lowering is controlled.",
            GEAR,
            "not identified: L_a, R_wc, R_ca, tau_wc, tau_ca (the paper's RE50): runs of a second, no temperature.",
            "R_0 is that of the winding as it was; T_0 and psi_R are the paper's.",
        ),
    ),
    "prony_gearmotor": (
        "GitHub gkret123/DC-Motor-Data-Analysis, commit 972c5218, GK_Data_M1.xlsx",
        "none stated: numbers fitted to the data, none of the data",
        "gearmotor_prony_brake",
        brake_points,
        (10.5, 11.0),
        "steady points at 5, 8.5 and 9.53 V on a hand-loaded brake; held out: {held}",
        (
            "An unnamed 12 V gear motor, gear included: torque and speed are the output shaft's. A student's data.",
            GEAR,
            "not identified: J, L_a, R_wc, R_ca, tau_wc, tau_ca (the paper's RE50): steady points alone.",
            "R_0 is that of the winding as it was; T_0 and psi_R are the paper's.",
        ),
    ),
}


def number(name: str, value: float, sd: float | None, source: str) -> str:
    """Return the TOML line of a number, to the digits that its sd leaves meaning."""
    spread = "" if sd is None else f", sd = {sd:.2g}"
    return f'{name} = {{ value = {value:.4g}{spread}, source = "{source}" }}\n'


def table(name: str, key: str, soc, values: np.ndarray, digits: int, source: str, degC=None) -> str:
    """Return the TOML of a curve, held from its lowest point down to SOC 0."""
    values = np.asarray(values, dtype=float)
    if soc[0] > 0.0:
        soc, values = (0.0, *soc), np.concatenate([values[..., :1], values], axis=-1)
    rounded = np.round(values, digits).tolist()
    rows = f"{key} = {rounded}\n"
    if degC is not None:
        rows = f"temperature_degC = {list(degC)}\n{key} = [\n" + "".join(f"    {row},\n" for row in rounded) + "]\n"
    return f'\n[parameters.{name}]\nsource = "{source}"\nsoc = {list(soc)}\n{rows}'


def head(name: str, kinds: list[str], data: str, licence: str, made_from: str, notes: tuple[str, ...]) -> str:
    """Return the top of a preset's file."""
    quoted = ", ".join(f'"{kind}"' for kind in kinds)
    lines = ["Made by examples/presets/make_presets.py; do not edit.", f"Made from: {made_from}.", *notes]
    comments = "".join(f"# {line}\n" for line in lines)
    keys = f'title = "{PRESETS[name]}"\nkinds = [{quoted}]\ndata = "{data}"\nlicence = "{licence}"\n'
    return f"{comments}{keys}\n[parameters]\n"


def held_out(run: str, column: str, rms: float) -> str:
    """Return the TOML of one figure."""
    print(f"    {run}: {column} {rms:.4g}")
    return f'\n[[held_out]]\nrun = "{run}"\ncolumn = "{column}"\nrms = {rms:.3g}\n'


def first_soc(rows: Rows, fitted: Fit) -> float:
    """Return the state of charge at the start of a run: from the voltage there if it is at rest, else full."""
    return float(np.interp(rows.voltage_V[0], fitted.ocv, OCV_SOC)) if abs(rows.current_A[0]) < STANDING else 1.0


def make_cell(name: str, cell: Cell, source: Path) -> None:
    """Write the preset of a cell."""
    fitted = fit(source, cell.plan)
    print(name, f"time constants {fitted.taus_s}", {k: f"{v * 1e3:.1f} mV" for k, v in fitted.rms_V.items()})
    runs = {file: read(source / cell.plan.folder, Test(file)) for file, _ in cell.held_out}
    asked = np.array([scale(fitted, cell.plan, rows, first_soc(rows, fitted)) for rows in runs.values()])
    print("    factors on resistance asked for:", asked)
    sd = max(float(np.sqrt(np.mean((asked - 1.0) ** 2))), LEAST_SD)
    why = "sd: how far from 1 the runs held out ask it to be, RMS"
    joint = f"joint least squares with ocv over all files it is made from, RMS {1e3 * rms_of(fitted):.0f} mV"
    seconds = ", ".join(f"{tau:.3g} s" for tau in fitted.taus_s)
    capacity_sd, capacity_why = cell.capacity_sd
    text = head(name, ["cell", "robot"], cell.data, cell.licence, cell.made_from, (*cell.notes, UNTOLD))
    text += number("capacity_Ah", fitted.capacity_Ah, capacity_sd, f"charge drawn from SOC 1 to 0; sd: {capacity_why}")
    nominal = float(np.trapezoid(fitted.ocv, OCV_SOC))
    text += number("nominal_cell_voltage_V", nominal, None, "mean of ocv over SOC")
    for zero in ("cycles", "storage_months"):
        text += number(zero, 0.0, None, "the tables are of the cell as it was tested, age included")
    text += number("series_resistance_scale", 1.0, sd, why)
    text += number("rc_resistance_scale", 1.0, sd, why)
    text += table("ocv", "voltage_V", OCV_SOC, fitted.ocv, 4, joint)
    degC = fitted.degC
    text += table("R_ints", "ohm", cell.plan.series_soc, fitted.tables["R_ints"], 5, joint, degC)
    for pair, tau in zip(("TS", "TL"), fitted.taus_s, strict=True):
        ohm = np.round(fitted.tables[f"R_{pair}"], 5)
        text += table(f"R_{pair}", "ohm", PAIR_SOC, ohm, 5, f"{joint}; time constants {seconds}", degC)
        # Between points R is a line and C = tau / R is none: C has points in between.
        between = np.array([np.interp(FINER_SOC, PAIR_SOC, row) for row in ohm])
        text += table(f"C_{pair}", "farad", FINER_SOC, tau / between, 0, "time constant divided by resistance", degC)
    write(name, text)
    figures = ""
    for file, chamber_degC in cell.held_out:
        rows = runs[file]
        ways = [("", chamber_degC, None), (", at its own temperature", rows.degC, None)]
        ways += [(", with self_heating", chamber_degC, cell.self_heating)] * (cell.self_heating is not None)
        for what, degC_of_run, heating in ways:
            error = voltage_error(name, rows, first_soc(rows, fitted), degC_of_run, heating)
            figures += held_out(file.removesuffix(".csv") + what, "voltage_V", float(np.sqrt(np.mean(error**2))))
    write(name, text + figures)


def rms_of(fitted: Fit) -> float:
    """Return the mean over files of the misfit, in V."""
    return float(np.sqrt(np.mean(np.square(list(fitted.rms_V.values())))))


def voltage_error(name: str, rows: Rows, soc: float, ambient_degC, heating: dict[str, float] | None) -> np.ndarray:
    """Return what the preset as written is off in V, at every row of a run."""
    later = np.append(True, np.diff(rows.time_s) > 0.0)
    model = with_values(preset_model(name, "cell"), {"initial_soc": jnp.asarray(soc)})
    if heating is not None:
        model = dataclasses.replace(model, effects=(make_effect("self_heating", heating, name),))
    inputs = {"current_A": rows.current_A[later], "ambient_degC": np.broadcast_to(ambient_degC, later.shape)[later]}
    ran = simulate(model, Profile(rows.time_s[later], inputs))
    return np.asarray(ran.readings["voltage_V"]) - rows.voltage_V[later]


def make_motor(name: str, source: Path) -> None:
    """Write the preset of a motor."""
    data, licence, folder, points_of, held, made_from, notes = MOTORS[name]
    points = points_of(source / folder)
    out = points.group.isin(held)
    found = estimate(points[~out])
    groups = ", ".join(f"{1e3 * mass:.0f} g" for mass in held) if folder == "hobby_servo_lift" else "10.5 and 11 V"
    filled = tuple(note.replace("EEE", f"{found.value['e']:.2f}") for note in notes)
    text = head(name, ["motor"], data, licence, made_from.format(held=groups), filled) + motor_numbers(found)
    write(name, text)
    figures = ""
    for what, loss in (("", 0.0), (", with gear_loss", found.value["e"])):
        error = motor_error(name, points[out], loss)
        for column, values in error.items():
            figures += held_out(groups + what, str(column), float(np.sqrt(np.mean(values**2))))
    write(name, text + figures)


def motor_numbers(found: Estimates) -> str:
    """Return the TOML of a motor's numbers."""
    how = {
        "R_0": "V = R i + k w over the points, least squares",
        "k_tau": "V = R i + k w over the points, least squares",
        "tau_0": "k i = tau_0 + (1 + e) load over the points, least squares",
        "J": "time constant R J / k^2 of the starts, against mass, at none",
    }
    left_out = "; sd: leaving out one load or voltage at a time"
    return "".join(number(n, found.value[n], found.sd[n], why + left_out) for n, why in how.items() if n in found.value)


def motor_error(name: str, points: pd.DataFrame, loss: float) -> pd.DataFrame:
    """Return what the preset is off in speed and current, a second after its start, the gear's loss put on the load."""
    model, errors = preset_model(name, "motor"), []
    for point in points.itertuples():
        load = (1.0 + loss) * point.load_torque_Nm
        ran = simulate(model, constant(1.0, 0.5, voltage_V=point.voltage_V, load_torque_Nm=load, ambient_degC=25.0))
        errors.append([float(ran.readings[c][-1]) - getattr(point, c) for c in ("speed_rad_s", "current_A")])
    return pd.DataFrame(errors, columns=["speed_rad_s", "current_A"])


def write(name: str, text: str) -> None:
    """Write a preset's file, and forget what was read of it before."""
    (FOLDER / f"{name}.toml").write_text(text, encoding="utf-8", newline="\n")
    read_preset.cache_clear()


def main(source: Path, names: list[str]) -> None:
    """Write the presets."""
    for name in names or [*CELLS, *MOTORS]:
        if name in CELLS:
            make_cell(name, CELLS[name], source)
        else:
            make_motor(name, source)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the presets of jaxmodel from measured data.")
    parser.add_argument("source", type=Path, help="folder of the source data")
    parser.add_argument("names", nargs="*", help="presets to make; all where none is named")
    given = parser.parse_args()
    main(given.source, given.names)
