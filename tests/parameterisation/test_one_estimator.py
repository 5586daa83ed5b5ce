"""What `parameterise` found is where a diagnosis stands: both use one estimator, and nothing is calibrated twice."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, Diagnosis, compare, read_case
from jaxmodel.parameterisation import Parameterisation, parameterise
from tests.parameterisation import made

SMALL = 0.05  # share of an error
# Of the larger of an sd: a calibration under weights that are estimated anew may differ by a little.
MOVED_SD = 0.5


def warm(degC: float = 25.0) -> dict[str, pd.DataFrame]:
    effects = {"self_heating": {"C_th": 60.0, "hA": 0.2}, "arrhenius_resistance": {"E_a": made.ENERGY}}
    frames = {
        "slow": made.slow(1.0),
        "pulses": made.pulses(degC),
        "fast": made.drive(degC).assign(current_A=6.0).iloc[:1000],
    }
    return made.measured(frames, thermometer=True, effects=effects)


def looped() -> tuple[dict[str, pd.DataFrame], dict[str, float]]:
    effects, starts = {"ocv_hysteresis": {"M_V": 0.02, "g": 60.0}}, {"charge": 0.0}
    frames = {"discharge": made.slow(1.0), "charge": made.slow(-1.0), "pulses": made.pulses(25.0)}
    return made.measured(frames, effects=effects, starts=starts), starts


def cases() -> dict[str, Case]:
    frames, starts = looped()
    return {"warm": made.raw_cell(warm()), "looped": made.raw_cell(frames, starts=starts)}


@pytest.fixture(scope="module", params=["warm", "looped"])
def both(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Parameterisation, Diagnosis]:
    found = parameterise(cases()[request.param], progress=False)
    written = read_case(found.write(tmp_path_factory.mktemp("written"), pictures=False))
    return found, compare(written, progress=False)


def test_calibration_of_the_written_case_changes_no_error(both: tuple[Parameterisation, Diagnosis]) -> None:
    nominal, calibrated = both[1].ladder
    for channel, stated in nominal.errors.items():
        assert calibrated.errors[channel].fit == pytest.approx(stated.fit, rel=SMALL)


def test_calibrated_is_never_worse_than_written(both: tuple[Parameterisation, Diagnosis]) -> None:
    nominal, calibrated = both[1].ladder
    for channel, stated in nominal.errors.items():
        assert calibrated.errors[channel].fit <= 1.02 * stated.fit


def test_numbers_of_both_are_the_same(both: tuple[Parameterisation, Diagnosis]) -> None:
    found, diagnosis = both
    for name, now in diagnosis.base.estimates.items():
        if "[" in name:
            continue
        effect, _, field = name.rpartition(".")
        if effect:
            before, sd = float(found.case.effects[effect][field]), found.case.effect_sd[effect][field]
        else:
            before, sd = found.case.parameters[name].value, found.case.parameters[name].sd
        assert abs(now.value - before) < MOVED_SD * max(sd or 0.0, now.sd), name


def test_heat_of_both_is_the_same(both: tuple[Parameterisation, Diagnosis]) -> None:
    found, diagnosis = both
    for name in ("C_th", "hA"):
        if f"self_heating.{name}" in diagnosis.base.estimates:
            assert found[name].value == pytest.approx(diagnosis.base.estimates[f"self_heating.{name}"].value, rel=0.01)


def test_no_start_or_table_leaves_0_to_1(both: tuple[Parameterisation, Diagnosis]) -> None:
    case = both[0].case
    for soc in (*(table.soc for table in case.tables.values()), *(run.initial_soc.value for run in case.runs)):
        assert np.min(soc) >= 0.0
        assert np.max(soc) <= 1.0
