"""The XML of an FMU: modelDescription.xml of FMI 2.0 and 3.0, and the buildDescription.xml of the latter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree

from jaxmodel.base.version import __version__
from jaxmodel.case.records import Case
from jaxmodel.data.tables.units import in_si
from jaxmodel.export.fmu_source import LONGEST_STEP, Source, Variable
from jaxmodel.export.wording import identifier
from jaxmodel.model.profile import Profile

_CAUSALITY = {"input": "input", "reading": "output", "valid": "output", "state": "local"}
_VARIABILITY = {"valid": "discrete", "tunable": "tunable", "fixed": "fixed"}


def model_description(case: Case, source: Source, profile: Profile, version: int, left_out: Sequence[str]) -> bytes:
    """Return modelDescription.xml.

    Args:
        case: whose model it is.
        source: its C, with its numbers.
        profile: of its first run, whose end and step are those by default.
        version: of FMI, 2 or 3.
        left_out: what the FMU does not carry.
    """
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": case.title,
            "guid" if version == 2 else "instantiationToken": source.token,
            "description": " ".join([f"A {case.kind} of jaxmodel, case '{case.name}'.", *left_out]),
            "generationTool": f"jaxmodel {__version__}",
            "variableNamingConvention": "structured",
        },
    )
    simulation = {"modelIdentifier": identifier(case.name), "canHandleVariableCommunicationStepSize": "true"}
    names = ("canGetAndSetFMUstate", "canSerializeFMUstate") if version == 2 else (
        "canGetAndSetFMUState", "canSerializeFMUState"
    )  # fmt: skip
    simulation |= dict.fromkeys(names, "true")
    if version == 2:
        simulation["canNotUseMemoryManagementFunctions"] = "true"
    kind = ElementTree.SubElement(root, "CoSimulation", simulation)
    if version == 2:
        ElementTree.SubElement(ElementTree.SubElement(kind, "SourceFiles"), "File", {"name": "fmi2.c"})
    _add_units(root, [*source.variables, Variable("time", "", "", "s")])
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", {"name": "logStatusError", "description": "what went wrong"})
    step = next(one.start for one in source.variables if one.name == LONGEST_STEP)
    times = {
        "startTime": "0.0",
        "stopTime": repr(float(profile.time_s[-1] - profile.time_s[0])),
        "stepSize": repr(step),
    }
    ElementTree.SubElement(root, "DefaultExperiment", times)
    _add_variables(ElementTree.SubElement(root, "ModelVariables"), source.variables, version)
    _add_structure(ElementTree.SubElement(root, "ModelStructure"), source.variables, version)
    return _bytes(root)


def build_description(case: Case) -> bytes:
    """Return buildDescription.xml of FMI 3.0."""
    root = ElementTree.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = ElementTree.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier(case.name)})
    files = ElementTree.SubElement(build, "SourceFileSet", {"language": "C99"})
    ElementTree.SubElement(files, "SourceFile", {"name": "fmi3.c"})
    return _bytes(root)


def _bytes(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_units(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    """Define each unit by SI base units, where it has some."""
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in sorted({one.unit for one in variables} - {""}):
        unit = ElementTree.SubElement(units, "Unit", {"name": name})
        if (found := in_si(name)) is not None:
            exponents, conversion = found
            numbers = {key: str(power) for key, power in exponents.items()}
            numbers |= {"factor": repr(conversion.factor)} if conversion.factor != 1.0 else {}
            numbers |= {"offset": repr(conversion.offset)} if conversion.offset else {}
            ElementTree.SubElement(unit, "BaseUnit", numbers)


def _add_variables(parent: ElementTree.Element, variables: Sequence[Variable], version: int) -> None:
    if version == 3:
        independent = {"name": "time", "valueReference": "0", "causality": "independent", "variability": "continuous"}
        ElementTree.SubElement(parent, "Float64", independent | {"unit": "s"})
    for number, one in enumerate(variables, start=1):
        about = {"name": one.name, "valueReference": str(number)}
        about |= {"description": one.meaning} if one.meaning else {}
        about["causality"] = _CAUSALITY.get(one.role, "parameter")
        about["variability"] = _VARIABILITY.get(one.role, "continuous")
        numbers = {"unit": one.unit} if one.unit else {}
        numbers |= {"min": repr(one.lower)} if math.isfinite(one.lower) else {}
        numbers |= {"max": repr(one.upper)} if math.isfinite(one.upper) else {}
        numbers |= {"start": repr(one.start)} if one.start is not None else {}
        if version == 2:
            variable = ElementTree.SubElement(parent, "ScalarVariable", about)
            ElementTree.SubElement(variable, "Boolean" if one.role == "valid" else "Real", numbers)
        else:
            ElementTree.SubElement(parent, "Boolean" if one.role == "valid" else "Float64", about | numbers)


def _add_structure(parent: ElementTree.Element, variables: Sequence[Variable], version: int) -> None:
    """Say which variables are outputs; each may depend on every input, as no dependencies are stated."""
    outputs = [str(number) for number, one in enumerate(variables, start=1) if one.role in ("reading", "valid")]
    if version == 3:
        for tag in ("Output", "InitialUnknown"):
            for number in outputs:
                ElementTree.SubElement(parent, tag, {"valueReference": number})
        return
    for tag in ("Outputs", "InitialUnknowns"):
        group = ElementTree.SubElement(parent, tag)
        for number in outputs:
            ElementTree.SubElement(group, "Unknown", {"index": number})
