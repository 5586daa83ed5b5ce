"""The real cases: what each is made of, what an expert expects, and what is asked of the error on held-out runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.real.a123 import PLANS, a123
from benchmarks.real.cells import LEAF_RUNS, dmegc, k2, leaf, lg_mj1, nasa, samsung_30q
from benchmarks.real.motors import gear_motor, propellers
from benchmarks.real.panasonic import OWN_RUNS, PRESET_RUNS, with_own_tables, with_preset

ROOT = Path(__file__).parents[2]
WORK = ROOT / ".real-cases"
WARM_CELL = ("self_heating", "arrhenius_resistance")
LFP_CELL = ("ocv_hysteresis", "arrhenius_resistance")


@dataclasses.dataclass(frozen=True)
class RealCase:
    """One real case.

    Attributes:
        name: of its folder.
        kind: "cell" or "motor".
        build: writes the case, given the folder of the measurements and the case's own.
        needs: the folder of measurements it is made from; "" where this repository holds all.
        fitted: the runs that may be fitted.
        check: the runs that judge.
        expects: effects of the catalogue that an expert expects; `a|b` is either of two that do the same work.
        targets: the most that is asked of the error on check runs, by channel, in its unit.
        harmless: whether it is small enough to be diagnosed again after each harmless change.
        remark: what to know of it.
    """

    name: str
    kind: str
    build: Callable[[Path, Path], None]
    needs: str
    fitted: str
    check: str
    expects: tuple[str, ...]
    targets: dict[str, float] = dataclasses.field(default_factory=dict)
    harmless: bool = False
    remark: str = ""


def _a123(name: str, fitted: str, check: str, **more) -> RealCase:
    return RealCase(name, "cell", partial(a123, plan=PLANS[name]), "a123_26650_plett", fitted, check, LFP_CELL, **more)


def _panasonic(name: str, fitted: str, check: str, **more) -> RealCase:
    own = name in OWN_RUNS
    build = partial(with_own_tables, runs=OWN_RUNS[name]) if own else partial(with_preset, runs=PRESET_RUNS[name])
    return RealCase(name, "cell", build, "panasonic_18650pf", fitted, check, WARM_CELL, **more)


def _leaf(name: str, fitted: str, check: str, **more) -> RealCase:
    build = partial(leaf, runs=LEAF_RUNS[name])
    return RealCase(name, "cell", build, "nissan_leaf_2013_cell", fitted, check, ("self_heating",), **more)


_PANASONIC_TARGETS = {"voltage_V": 0.045, "cell_temperature_degC": 0.6}
_UNSEEN = "US06 at 25, 10, 0, -20 degC, Cycle 3 at 25 degC"

_ALL = (
    RealCase(
        "samsung_30q",
        "cell",
        samsung_30q,
        "",
        "1C, 2C, 3C",
        "4C",
        WARM_CELL,
        targets={"voltage_V": 0.011, "cell_temperature_degC": 0.45},
        harmless=True,
    ),
    _panasonic("panasonic_drive", "US06 at 25, 10, 0 degC", "US06 at -20 degC"),
    _panasonic(
        "panasonic_cycle1",
        "Cycle 1 at 25, 10, 0 degC",
        "Cycle 1 at -20 degC, NN at 10 degC",
        remark="the preset's tables have seen NN at 10 degC",
    ),
    _panasonic("panasonic_cold", "NN at 25, -20 degC, US06 at 0 degC", "US06 at -20 degC, Cycle 3 at 25 degC"),
    _panasonic(
        "panasonic_four",
        "Cycle 1 at 25, 0 degC, NN at 10, -20 degC",
        _UNSEEN,
        targets=_PANASONIC_TARGETS,
        remark="tables from C/20 and pulses at 25 degC",
    ),
    _panasonic(
        "panasonic_pulses",
        "as panasonic_four, and pulses at 25, 10, 0, -20 degC",
        _UNSEEN,
        targets=_PANASONIC_TARGETS,
        remark="tables from C/20 and pulses at 25 degC",
    ),
    _a123("a123_lfp", "dynamic at 25, 45, 5 degC, slow branches at 25 degC", "dynamic at -5 degC"),
    _a123("a123_cold", "dynamic at 5, -25 degC, slow branches at 5 degC", "dynamic at -5 degC"),
    _a123(
        "a123_warm",
        "dynamic and slow branches at 5 and 45 degC",
        "dynamic and slow branches at 25 degC",
        targets={"voltage_V": 0.012},
        remark="tables from 45 degC; no file of 15 or 35 degC exists here",
    ),
    RealCase("k2_lfp", "cell", k2, "k2_lfp_26650", "pulses and 1C at 30, 20 degC", "both at 50 degC", WARM_CELL),
    RealCase(
        "lg_mj1", "cell", lg_mj1, "lg_mj1_18650", "pulses at 28, 20 degC", "pulses at 40 degC", WARM_CELL, harmless=True
    ),
    RealCase(
        "dmegc_18650",
        "cell",
        dmegc,
        "dmegc_18650_electrothermal",
        "0.5C pulses, 0.5C, 1C at 25 degC",
        "2C",
        ("self_heating",),
        harmless=True,
    ),
    RealCase(
        "nasa_ageing",
        "cell",
        nasa,
        "nasa_18650_ageing",
        "discharges 1, 22, 64, 105",
        "discharges 147, 168",
        ("self_heating", "resistance_ageing|capacity_fade"),
        harmless=True,
        remark="an expert sees the capacity fall first",
    ),
    _leaf(
        "leaf",
        "first C/2 and 1C cycle, 3C",
        "second C/2 and 1C cycle",
        targets={"cell_temperature_degC": 0.6},
        harmless=True,
    ),
    _leaf("leaf_3c", "two C/2 and 1C cycles", "3C", remark="three times the current that was fitted"),
    RealCase(
        "gear_motor",
        "motor",
        gear_motor,
        "gearmotor_prony_brake",
        "5, 8.5, 9.53 V",
        "10.5, 11 V",
        ("gear_loss",),
        harmless=True,
    ),
    RealCase(
        "propellers",
        "motor",
        propellers,
        "crazyflie21_brushed",
        "duty 0.15 to 0.8, rising",
        "0.8 to 1; 0.8 to 0.15, falling",
        ("windage",),
        harmless=True,
    ),
)
CASES = {case.name: case for case in _ALL}


def find_data(given: Path | None = None) -> Path:
    """Return the folder of the measurements: the one given, or `shared/data` beside or in the checkout.

    Raises:
        FileNotFoundError: there is none.
    """
    places = [given] if given else [ROOT.parent / "shared" / "data", ROOT / "shared" / "data"]
    for place in places:
        if place.is_dir():
            return place
    raise FileNotFoundError("There is no folder shared/data beside the checkout; name the measurements with --data.")


def build(case: RealCase, source: Path, work: Path = WORK) -> Path:
    """Write one case anew and return its folder."""
    out = work / case.name
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("*.csv"):
        old.unlink()
    case.build(source, out)
    return out
