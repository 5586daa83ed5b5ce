"""`jaxmodel demo`: sweep, sensitivities and diagnosis of examples, on one page."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

# Imported first: sweeps configures JAX for all cores, which must happen before the first array.
from jaxmodel import sensitivity, sweeps
from jaxmodel.app import terminal
from jaxmodel.app.commands.diagnose import DONE_BY, print_diagnosis
from jaxmodel.app.commands.sensitivity import print_sensitivity
from jaxmodel.app.commands.start import start
from jaxmodel.app.commands.sweep import print_sweep, run_study
from jaxmodel.app.page import write_page
from jaxmodel.app.report import report_content, write_report
from jaxmodel.app.shipped import EXAMPLES
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis import Diagnosis, diagnose
from jaxmodel.diagnosis.summary import error_in_short
from jaxmodel.diagnosis.wording import effect_name, join, verdict_sentence
from jaxmodel.plots.sensitivities import doubling_beside_gradient, elasticities, over_time
from jaxmodel.plots.style import png
from jaxmodel.plots.sweeps import against_paper, family, heat_map

POINT = {"ambient_degC": 20.0, "load_torque_Nm": 0.175}
# The paper's Tables 1 and 2: change of the state of charge [1/s] over ambient [degC], and over torque [N m].
TABLE_1 = {-20.0: -2.8e-4, 0.0: -2.5e-4, 20.0: -2.1e-4, 40.0: -1.6e-4, 60.0: -1.3e-4, 80.0: -0.9e-4, 100.0: -0.5e-4}
TABLE_2 = {0.175: -2.0e-4, 0.25: -2.8e-4, 0.3: -3.4e-4, 0.35: -3.8e-4}
_PAPERS_AGE = {"storage_months": 18.0, "cycles": 25.0}
_STORED_EVERY_ROWS = 30
_GRADIENT = "soc_gradient"


def demo(out: Path, case_path: Path | None) -> None:
    """Sweep and differentiate the robot of the paper, diagnose a real cell, and write `out/index.html`.

    Raises:
        UserError: the case cannot be used.
    """
    began = time.perf_counter()
    case = read_case(case_path or EXAMPLES / "samsung_30q")
    start(out)
    study = sweeps.read_study(EXAMPLES / "paper_sweep.toml")

    dataset = run_study(study.replace(store=["soc"], store_every=_STORED_EVERY_ROWS))
    sweeps.save(dataset, out / "sweep")
    print_sweep(dataset)
    pictures = _sweep_pictures(dataset)

    with terminal.stages("sensitivity") as progress:
        progress("differentiating and doubling")
        at_point = study.at(POINT).replace(
            metrics=[_GRADIENT, "delivered_energy_Wh", "min_pack_voltage_V"], store=["pack_voltage_V"]
        )
        data = sensitivity.local(at_point, progress=False)
    print_sensitivity(data)
    pictures |= {
        "doubling": png(doubling_beside_gradient(data, _GRADIENT)),
        "elasticities": png(elasticities(data)),
        "over-time": png(over_time(data, "pack_voltage_V")),
    }
    for name, picture in pictures.items():
        write_whole(out / f"{name}.png", picture)

    folder = out / case.name
    with terminal.stages(case.name, DONE_BY) as progress:
        diagnosis = diagnose(case, progress=progress)
        diagnosis.write(folder, pictures=False)
        progress("pictures and report")
        pictures |= write_report(diagnosis, folder)
    print_diagnosis(diagnosis)

    numbers = numbers_that_matter(dataset, data, diagnosis)
    write_page(
        out / "index.html",
        "demo.html",
        numbers=numbers,
        lanes=dataset["status"].size,
        age=_age(dataset),
        misfit_1=_misfit(dataset, "ambient_degC", TABLE_1),
        misfit_2=_misfit(dataset, "load_torque_Nm", TABLE_2),
        minutes=(time.perf_counter() - began) / 60.0,
        **report_content(diagnosis, pictures),
    )
    for name, value in numbers.items():
        terminal.say(f"{name}: {value}")
    terminal.say(f"All results are on one page: {out / 'index.html'}")


def _at_papers_age(dataset: xr.Dataset) -> xr.Dataset:
    """Return the lanes nearest to the paper's battery: 18 months stored, 25 cycles."""
    return dataset.sel(_PAPERS_AGE, method="nearest")


def _age(dataset: xr.Dataset) -> str:
    chosen = _at_papers_age(dataset)
    return f"{float(chosen['storage_months']):g} months of storage and {float(chosen['cycles']):g} cycles"


def _rate(dataset: xr.Dataset, **at: float) -> float:
    return float(_at_papers_age(dataset)[_GRADIENT].sel(at, method="nearest"))


def _misfit(dataset: xr.Dataset, axis: str, table: Mapping[float, float]) -> str:
    """Return the largest difference of the simulated rates from those of a table of the paper, in percent."""
    off = [abs(_rate(dataset, **(POINT | {axis: at})) / printed - 1.0) for at, printed in table.items()]
    return f"{100.0 * max(off):.0f} %"


def _sweep_pictures(dataset: xr.Dataset) -> dict[str, bytes]:
    """Return figures 6 and 7 and both tables of the paper as simulated, and the lowest voltage over both axes."""
    paper = _at_papers_age(dataset)
    over_ambient = {float(t): _rate(dataset, **(POINT | {"ambient_degC": float(t)})) for t in paper["ambient_degC"]}
    over_torque = {float(t): _rate(dataset, **(POINT | {"load_torque_Nm": float(t)})) for t in paper["load_torque_Nm"]}
    panels = [
        ("ambient [°C], at 175 mN m", over_ambient, TABLE_1),
        ("load torque [mN m], at 20 °C", _in_milli(over_torque), _in_milli(TABLE_2)),
    ]
    at_torque = paper.sel(load_torque_Nm=POINT["load_torque_Nm"], method="nearest")
    at_ambient = paper.sel(ambient_degC=POINT["ambient_degC"], method="nearest")
    age = _age(dataset)
    return {
        "figure-6": png(family(at_torque, "soc", "ambient_degC", f"175 mN m, {age}", TABLE_1)),
        "figure-7": png(family(at_ambient, "soc", "load_torque_Nm", f"20 °C, {age}", TABLE_2)),
        "against-paper": png(against_paper(panels)),
        "lowest-voltage": png(heat_map(paper, "min_pack_voltage_V", "load_torque_Nm", "ambient_degC", age)),
    }


def _in_milli(values: Mapping[float, float]) -> dict[float, float]:
    return {1e3 * key: value for key, value in values.items()}


def numbers_that_matter(dataset: xr.Dataset, data: xr.Dataset, diagnosis: Diagnosis) -> dict[str, str]:
    """Return the five main results by name."""
    ours, papers = _rate(dataset, **POINT), TABLE_2[POINT["load_torque_Nm"]]
    name, elasticity = sensitivity.largest_elasticity(data, _GRADIENT)
    named = [f"{effect_name(e.label)} ({e.probability:.2f})" for e in diagnosis.effects]
    errors = "; ".join(error_in_short(diagnosis, channel) for channel in diagnosis.noise)
    held_out = any(run.split == "check" for run in diagnosis.case.runs)
    return {
        "Swept": f"{dataset['status'].size:,} lanes at {sweeps.lanes_per_second(dataset):,.0f} lanes/s",
        "Discharge at 20 °C and 175 mN m": f"{_power(ours)} per second; the paper's Table 2 has {_power(papers)}",
        "Largest elasticity of the discharge": f"{elasticity:+.2f} by {name}",
        "Missing from the model of the real cell": join(named) or verdict_sentence(diagnosis),
        f"RMS error on {'check' if held_out else 'fit'} runs, before → after": errors,
    }


def _power(value: float) -> str:
    exponent = int(np.floor(np.log10(abs(value))))
    return f"{value / 10.0**exponent:.2f}e{exponent}"
