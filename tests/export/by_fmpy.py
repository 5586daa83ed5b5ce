"""Run by FMPy's Python: FMUs, validated and simulated under the rows of a run; prints JSON."""

import json
import shutil
import sys

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu


class Slave:
    """An instance of an FMU of either version, with its variables by name."""

    def __init__(self, description, folder, name, parameters, inputs):
        self.is_3 = description.fmiVersion.startswith("3")
        self.references = {one.name: one.valueReference for one in description.modelVariables}
        self.outputs = [one.name for one in description.modelVariables if one.causality == "output"]
        self.reals = [name for name in self.outputs if name != "valid"]
        identifier = description.coSimulation.modelIdentifier
        kind = FMU3Slave if self.is_3 else FMU2Slave
        self.slave = kind(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName=name)
        self.slave.instantiate()
        self.start(parameters, inputs)

    def start(self, parameters, inputs, start_s=0.0):
        self.time_s = start_s
        if not self.is_3:
            self.slave.setupExperiment(startTime=start_s)
        self.set(parameters)
        (self.slave.enterInitializationMode(startTime=start_s) if self.is_3 else self.slave.enterInitializationMode())
        self.set(inputs)
        self.slave.exitInitializationMode()

    def set(self, values):
        references = [self.references[name] for name in values]
        (self.slave.setFloat64 if self.is_3 else self.slave.setReal)(references, list(values.values()))

    def get(self, names):
        return (self.slave.getFloat64 if self.is_3 else self.slave.getReal)([self.references[name] for name in names])

    def read(self):
        return list(self.get(self.reals))

    def is_valid(self):
        return bool(self.slave.getBoolean([self.references["valid"]])[0])

    def step(self, inputs, seconds):
        self.set(inputs)
        self.slave.doStep(self.time_s, seconds)
        self.time_s += seconds

    def stored(self):
        state = self.slave.getFMUState() if self.is_3 else self.slave.getFMUstate()
        done = self.slave.serializeFMUState(state) if self.is_3 else self.slave.serializeFMUstate(state)
        (self.slave.freeFMUState if self.is_3 else self.slave.freeFMUstate)(state)
        return done

    def restored(self, done, time_s):
        if self.is_3:
            state = self.slave.deserializeFMUState(done)
            self.slave.setFMUState(state)
            self.slave.freeFMUState(state)
        else:
            state = self.slave.deSerializeFMUstate(done)
            self.slave.setFMUstate(state)
            self.slave.freeFMUstate(state)
        self.time_s = time_s

    def end(self):
        self.slave.terminate()
        self.slave.freeInstance()


def fails(function, *words):
    """Return whether a call of the FMU is refused."""
    try:
        function(*words)
    except fmpy.fmi1.FMICallException:
        return True
    return False


def main(path, given):
    """Print what FMPy finds in an FMU, and its readings at the rows of a run: once, and again in other ways."""
    with open(given, encoding="utf-8") as file:
        given = json.load(file)
    parameters, time_s = given["parameters"], np.array(given["time_s"])
    rows = [dict(zip(given["inputs"], values, strict=True)) for values in zip(*given["inputs"].values(), strict=True)]
    description, folder = fmpy.read_model_description(path), fmpy.extract(path)
    half = len(rows) // 2

    # One instance over the whole run; beside it another that stands still, and is later put where the first was.
    one, other = (Slave(description, folder, name, parameters, rows[0]) for name in ("one", "other"))
    start = other.read()
    found, valid = [one.read()], [one.is_valid()]
    for k in range(1, len(rows)):
        one.step(rows[k], time_s[k] - time_s[k - 1])
        found.append(one.read())
        valid.append(one.is_valid())
        if k == half:
            stored = one.stored()
    stood = other.read() == start
    other.restored(stored, one.time_s - (time_s[-1] - time_s[half]))
    for k in range(half + 1, len(rows)):
        other.step(rows[k], time_s[k] - time_s[k - 1])
    restored = other.read() == found[-1]

    # The same instance once more; and what must be refused.
    one.slave.reset()
    one.start(parameters, rows[0])
    again = one.read() == found[0]
    for k in range(1, len(rows)):
        one.step(rows[k], time_s[k] - time_s[k - 1])
    again = again and one.read() == found[-1]
    refused = {
        "a step back": fails(one.slave.doStep, one.time_s - 100.0, 1.0),
        "a negative step": fails(one.slave.doStep, one.time_s, -1.0),
        "a reading": fails(one.set, {one.reals[0]: 1.0}),
        "not a number": fails(one.set, {next(iter(rows[0])): float("nan")}),
    }
    fixed = [v.name for v in description.modelVariables if v.causality == "parameter" and v.variability == "fixed"]
    refused |= {"the start": fails(one.set, {fixed[0]: 0.5})} if fixed else {}
    kept = one.read() == found[-1]

    # All at once: the last inputs held for as long as the run, which the FMU cuts into its own steps.
    other.slave.reset()
    other.start(parameters, rows[0])
    other.step(rows[-1], time_s[-1] - time_s[0])
    held = other.read()
    simulated = fmpy.simulate_fmu(
        path, stop_time=time_s[-1] - time_s[0], output_interval=time_s[-1] - time_s[0], output=other.reals,
        start_values=parameters | rows[-1],
    )  # fmt: skip
    one.end()
    other.end()
    shutil.rmtree(folder)
    print(
        json.dumps(
            {
                "version": fmpy.__version__,
                "problems": validate_fmu(path),
                "names": one.reals,
                "readings": np.transpose(found).tolist(),
                "valid": valid,
                "held": held,
                "simulated": list(simulated[-1])[1:],
                "units": {v.name: v.unit for v in description.modelVariables},
                "parameters": [v.name for v in description.modelVariables if v.causality == "parameter"],
                "alike": {"stood": stood, "restored": restored, "again": again, "kept": kept},
                "refused": refused,
            }
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
