"""From a case or preset to models and profiles."""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.base.errors import EffectError, ParameterError, instead
from jaxmodel.case.presets import Kind, read_preset, why_not
from jaxmodel.case.records import Case, Run
from jaxmodel.case.servo import first_of, servo_effects
from jaxmodel.case.specimens import differences, own_parameters
from jaxmodel.effects import CATALOGUE, own_effects
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.effects.loads import GravityLoad
from jaxmodel.effects.motor_tables import TABLES
from jaxmodel.model.curves import CURVE_NAMES, CellCurves, Curve, Table, look_up_curves
from jaxmodel.model.declaration import describe
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters, info
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile

FIDELITIES = ("formula", "lut")
# Share of a voltage below which it is off, and below which a back-emf is that of a motor that stands. Assumed.
_IS_ON = 0.02


def make_effect(
    name: str, values: Mapping[str, Any], where: str, catalogue: Mapping[str, type[Effect]] = CATALOGUE
) -> Effect:
    """Return an effect of the catalogue with parameter values, checked against its parameter table.

    Args:
        name: the effect's name.
        values: its parameters by name; a sensor effect also takes `column`.
        where: file and place, for messages.
        catalogue: the known effects by name.

    Raises:
        EffectError: unknown effect or parameter; the message gives the nearest name.
    """
    if name not in catalogue:
        raise EffectError(f"{where}: no effect is called '{name}'.{instead(name, catalogue)} {own_effect_hint(name)}")
    cls = catalogue[name]
    table = describe(cls)
    numbers: dict[str, Any] = {}
    for field, given in values.items():
        if field == "column" and cls.is_sensor:
            continue
        if field not in table:
            raise EffectError(
                f"{where}: effect '{name}' has no parameter '{field}'."
                f"{instead(field, [*table, *(['column'] if cls.is_sensor else [])])}"
            )
        numbers[field] = table[field].check(given, f"{where}, effect '{name}'")
    if not cls.is_sensor:
        return cls(**numbers)
    column = values.get("column") or cls.column
    if cls.reads and not column:
        raise EffectError(f"{where}: effect '{name}' needs a column, one that ends in {cls.reads}.")
    return cls(**numbers, column=column)


def own_effect_hint(name: str) -> str:
    """Say how an effect of the user's own is given, who may have meant one by a name that is not in the catalogue."""
    example = "found_law.py:FoundLaw" if name == "found_law" else "FILE.py:CLASS"
    return f"Give an effect of your own by --effect {example}."


def load_effect_class(reference: str) -> type[Effect]:
    """Return the effect class that `path/to/file.py:ClassName` names, from a user's own file.

    Raises:
        EffectError: the file or class is not there, or the class is not an effect.

    Example:
        >>> from jaxmodel import load_effect_class
        >>> load_effect_class("examples/my_effects.py:HotContact").name
        'hot_contact'
    """
    file, _, class_name = reference.partition(":")
    path = Path(file)
    if not class_name or not path.is_file():
        raise EffectError(f"--effect {reference}: give an existing file and a class, as in my_effects.py:MagnetAgeing.")
    spec = importlib.util.spec_from_file_location(f"own_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where a dataclass looks up annotations that are text
    try:
        spec.loader.exec_module(module)
    except EffectError as error:
        raise EffectError(f"--effect {reference}: {error}") from error
    except (Exception, SystemExit) as error:
        why = "it ends the program" if isinstance(error, SystemExit) else error
        raise EffectError(f"--effect {reference}: the file does not run ({why}); correct it there.") from error
    cls = getattr(module, class_name, None)
    if not (inspect.isclass(cls) and issubclass(cls, Effect)):
        raise EffectError(
            f"--effect {reference}: {path.name} has no class '{class_name}' derived from jaxmodel.Effect; add it."
        )
    try:
        own_effects([cls])
    except EffectError as error:
        raise EffectError(f"--effect {reference}: {error}") from error
    return cls


def with_preset(case: Case) -> Case:
    """Return a case with the values and sd of its preset; entries of the case take precedence.

    Raises:
        ParameterError: the preset is unknown or serves other kinds.
    """
    if problem := why_not(case.preset, case.kind):
        raise ParameterError(f"{case.label}: {problem}")
    preset = read_preset(case.preset)
    parameters, curves = preset.parameters | case.parameters, preset.tables | case.tables
    return dataclasses.replace(case, parameters=parameters, tables=curves)


def case_model(
    case: Case,
    run: Run | None = None,
    *,
    fidelity: str = "formula",
) -> Model:
    """Return the model of a case: preset, parameters, tables and effects; for one run with its overrides.

    Raises:
        ParameterError: the preset is unknown or serves other kinds.
        EffectError: an effect is unknown or does not apply to the kind.

    Example:
        >>> from jaxmodel import case_model, read_case
        >>> case_model(read_case("examples/samsung_30q")).kind
        'cell'
    """
    where = case.label
    case = with_preset(case)
    known: dict[str, Any] = {name: entry.value for name, entry in case.parameters.items()}
    if run is not None:
        known |= {name: entry.value for name, entry in (own_parameters(case, run) | run.overrides).items()}
        known["initial_soc"] = run.initial_soc.value
        if run.initial_cell_temperature is not None:
            ambient = float(run.measured.inputs["ambient_degC"][0])
            known["initial_temperature_rise_K"] = run.initial_cell_temperature.value - ambient
        if case.kind == "motor" and (current := first_current(run, known)):
            known.setdefault("initial_current_A", current)
    curves = CellCurves()
    if fidelity == "lut":
        curves = look_up_curves(curves)
    chosen: dict[str, Curve] = {name: getattr(curves, name) for name in CURVE_NAMES}
    chosen |= {
        name: Table(table.soc, table.values, table.temperature_degC)
        for name, table in case.tables.items()
        if name in (*CURVE_NAMES, "dU_dT")
    }
    given = case.effects if run is None else case.effects | _first_position(case, run)
    effects = tuple(make_effect(name, values, where, case.catalogue) for name, values in given.items())
    own = (make_effect(name, values, where, DIFFERENCES) for name, values in differences(case, run))
    effects = (*_motor_tables(case), *effects, *own)
    if case.kind == "motor":
        effects = servo_effects(case, run, effects)
    for effect in effects:
        if case.kind not in effect.kinds:
            raise EffectError(
                f"{where}: effect '{effect.name}' applies to {' and '.join(effect.kinds)}, "
                f"not to kind '{case.kind}'; remove it."
            )
        columns = [column for column in case.vocabulary.columns if column.endswith(effect.reads)]
        if effect.column and effect.column not in columns:
            raise EffectError(
                f"{where}: effect '{effect.name}' cannot act on the column '{effect.column}'."
                f"{instead(effect.column, columns)}"
            )
    return Model(kind=case.kind, parameters=Parameters(**known), curves=CellCurves(**chosen), effects=effects)


def _motor_tables(case: Case) -> list[Effect]:
    """Return the curves of a motor, which act on the model as effects do.

    Raises:
        ParameterError: the case has no motor.
    """
    if case.motor_tables and case.kind == "cell":
        name = next(iter(case.motor_tables))
        raise ParameterError(
            f"{case.label}: [parameters] {name} is a table of a motor, and the case is of a cell; remove it."
        )
    return [TABLES[name](table.at, table.values) for name, table in case.motor_tables.items()]


def _first_position(case: Case, run: Run) -> dict[str, dict[str, float | str]]:
    """Return the effect of a weight on an arm with the first position that a run reads, if none is stated."""
    name, field = GravityLoad.name, "initial_position_rad"
    read = first_of(run, "position_rad")
    if name not in case.effects or field in case.effects[name] or read is None:
        return {}
    return {name: case.effects[name] | {field: read}}


def first_current(run: Run, known: Mapping[str, float]) -> float:
    """Return the current [A] with which a motor's run begins: 0 unless its voltage is on in the first row.

    The winding's own time constant is some milliseconds, so that a run that begins under load begins with the current
    of its first row: as read, else, if it turns, in equilibrium, i = (V - k_tau w) / R_0 (eq. 11 with di/dt = 0).

    Args:
        run: of a motor.
        known: values of its parameters by name.

    Example:
        >>> from jaxmodel import preset_model
        >>> preset_model("samsung_30q", "cell").kind
        'cell'
    """
    voltage, read = run.measured.inputs.get("voltage_V"), run.measured.outputs.get("current_A")
    if voltage is None or abs(voltage[0]) <= _IS_ON * np.abs(voltage).max():
        return 0.0
    if read is not None and np.isfinite(read[0]):
        return float(read[0])
    R, k, speed = (known.get(name, info(name).default) for name in ("R_0", "k_tau", "initial_speed_rad_s"))
    turning = run.measured.outputs.get("speed_rad_s")
    if turning is not None and np.isfinite(turning[0]):
        speed = float(turning[0])
    # A motor that stands has been switched on just now.
    turns = abs(k * speed) > _IS_ON * abs(voltage[0])
    return float((voltage[0] - k * speed) / R) if turns else 0.0


def preset_model(name: str, kind: Kind) -> Model:
    """Return the model of a preset; other values are those of the paper.

    Raises:
        ParameterError: the preset is unknown or serves other kinds.

    Example:
        >>> from jaxmodel import preset_model
        >>> round(float(preset_model("samsung_30q", "cell").parameters.capacity_Ah), 2)
        2.99
    """
    return case_model(Case("preset", Path("preset_model"), "", kind, name, {}, {}, {}, {}, (), {}))


def run_profile(run: Run) -> Profile:
    """Return the inputs of a measured run as a profile.

    Example:
        >>> from jaxmodel import read_case, run_profile
        >>> run_profile(read_case("examples/samsung_30q").runs[0])
        <Profile: 933 rows, 0 to 3548 s, current_A, ambient_degC>
    """
    return Profile(run.measured.time_s, run.measured.inputs)
