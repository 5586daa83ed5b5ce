"""`Investigation`: a diagnosis step by step.

investigation = Investigation(case)
investigation.errors()            # by run and channel, against noise and tolerance
investigation.where()             # where the present model fails, in sentences
investigation.regime_map("voltage_V")  # the same as means over ranges of two conditions
investigation.candidates()        # ranked effects, sensor faults, curves and shifts
investigation.preview("self_heating")  # the residual that it would leave, before any refit
investigation.add("self_heating")
investigation.drop("self_heating")
investigation.undo()
investigation.ladder()            # every model so far
"""

from __future__ import annotations

import dataclasses
import functools
import html
from collections.abc import Callable

import pandas as pd

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.case.measurements import KINDS
from jaxmodel.case.records import Case
from jaxmodel.diagnosis import policy
from jaxmodel.diagnosis.evidence.trial import Settled
from jaxmodel.diagnosis.extended import extended_case
from jaxmodel.diagnosis.findings import curve_found, run_found
from jaxmodel.diagnosis.fitting.lanes import one_thread_of_blas
from jaxmodel.diagnosis.plotting import InvestigationPlots
from jaxmodel.diagnosis.residuals.regime_map import RegimeMap, regime_map
from jaxmodel.diagnosis.residuals.statements import statements
from jaxmodel.diagnosis.result import Rung
from jaxmodel.diagnosis.rungs import errors_by_run, residuals_of, rung
from jaxmodel.diagnosis.workings import Workings


class Investigation(Workings):
    """One case and its present model, at first the calibrated base model.

    Arguments as `jaxmodel.diagnosis.workings.Workings`. Fitted models are kept, and their numbers do not depend on the
    order of additions.
    """

    _present: tuple[str, ...] = ()
    _path: tuple[tuple[str, ...], ...] = ((),)

    @property
    def model(self) -> Settled:
        """Return the present model."""
        return self.settled(self._present)

    @property
    def added(self) -> tuple[str, ...]:
        """Return the additions of the present model to the base model."""
        return self._present

    @property
    def plot(self) -> InvestigationPlots:
        """Return the pictures: `plot.ladder()`, `plot.run("name")`, `plot.errors()`, `plot.candidates()`."""
        return InvestigationPlots(self)

    @functools.cached_property
    def _rungs(self) -> dict[tuple[str, ...], Rung]:
        """Models with their errors and predictions, which take a simulation of every run."""
        return {}

    def _rung(self, labels: tuple[str, ...]) -> Rung:
        if labels not in self._rungs:
            self._rungs[labels] = rung(self, "", self.settled(labels))
        return self._rungs[labels]

    def present(self) -> Rung:
        """Return the present model's parameters, errors and predictions."""
        return dataclasses.replace(self._rung(self._present), name="present")

    def models(self) -> list[Rung]:
        """Return every model so far once, the calibrated base model first."""
        return [self._rung(labels) for labels in dict.fromkeys(self._path)]

    def parameters(self) -> pd.DataFrame:
        """Return the present model's fitted numbers: name, value, sd of the fit, unit, and whether it left its prior.

        `strained` is True for a number further than three of its stated sd from its stated value.
        """
        last = self.present()
        rows = [(name, one.value, one.sd, one.unit, name in last.at_bound) for name, one in last.estimates.items()]
        return pd.DataFrame(rows, columns=["name", "value", "sd", "unit", "strained"])

    def extended_case(self) -> Case:
        """Return the case with the parameters, effects and tables of the present model."""
        last, model = self.present(), self.model
        group = {label: self.space.candidates[label].group for label in model.labels}
        curves = [curve_found(self, model, label, {}) for label in model.labels if group[label] == "curve"]
        runs = [run_found(self, model, last, label, {}) for label in model.labels if group[label] == "run"]
        return extended_case(self.case, last, curves, runs)[0]

    def __repr__(self) -> str:
        return f"<Investigation of {self.case.name}: {' + '.join(self._present) or 'base model'}>"

    def _repr_html_(self) -> str:
        return f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>{self.ladder().to_html(index=False, border=0)}"

    @one_thread_of_blas
    def errors(self) -> pd.DataFrame:
        """Return the present model's errors: a row for each channel of each run, against noise and tolerance."""
        return errors_by_run(self, {"present": self.present()}).drop(columns="model")

    @one_thread_of_blas
    def where(self) -> pd.DataFrame:
        """Return where the present model fails: channel, sentence, and the share of the channel's mean square."""
        capacity = self.case.parameters.get("capacity_Ah")
        rows = [
            (residuals.channel, one.text, one.share)
            for residuals in residuals_of(self, self.present())
            for one in statements(residuals, capacity_Ah=None if capacity is None else capacity.value)
        ]
        return pd.DataFrame(rows, columns=["channel", "sentence", "share"])

    @one_thread_of_blas
    def regime_map(self, channel: str) -> RegimeMap:
        """Return the present model's residual of one channel over ranges of the two conditions that place it best.

        Args:
            channel: as `errors` lists it.

        Raises:
            MeasurementError: no run has readings of this channel.
        """
        found = {residuals.channel: residuals for residuals in residuals_of(self, self.present())}
        if channel not in found:
            raise MeasurementError(f"regime_map: there are no readings of '{channel}'.{nearest(channel, found)}")
        return regime_map(found[channel])

    @one_thread_of_blas
    def candidates(self) -> pd.DataFrame:
        """Return the candidates, the best first by a linear estimate of their gain of log evidence.

        A gain of 3 is odds of 20 to 1; a candidate must gain more where many could explain the readings.
        """
        rows = [
            (gain.label, self.space.candidates[gain.label].group, gain.log_evidence, gain.chi2, gain.z)
            for gain in self.linear(self.model).gains()
        ]
        return pd.DataFrame(rows, columns=["name", "group", "log_evidence", "chi2", "z"])

    @one_thread_of_blas
    def preview(self, *names: str) -> pd.DataFrame:
        """Return the residual of the present model, and what candidates would leave of it, without any refit.

        To first order, as the scores of `candidates`: a candidate far from linear does better or worse once refitted.

        Args:
            names: as `candidates` lists them; all of them by default.

        Returns:
            A row for each fitted reading: run, channel, time_s, `residual`, and a column for each name, in the unit of
            the channel (K for temperatures). A candidate that these readings cannot show has no column.

        Raises:
            EffectError: a name is no candidate of this case.
        """
        linear, readings = self.linear(self.model), self.model.scale.view.readings
        outputs = KINDS[self.case.kind].outputs
        table = {
            "run": [self.case.runs[number].name for number in readings.run],
            "channel": [outputs[number] for number in readings.channel],
            "time_s": readings.time_s,
            "residual": self.errors_of(self.model),
        }
        labels = self.space.labels_of(names) if names else [gain.label for gain in linear.gains()]
        left = {label: linear.left_with(label) for label in labels}
        return pd.DataFrame(table | {label: one for label, one in left.items() if one is not None})

    @one_thread_of_blas
    def add(self, *names: str) -> Investigation:
        """Add effects, sensor faults, curves or shifts of single runs to the model, refit it, and return it.

        Args:
            names: as `candidates` lists them.

        Raises:
            EffectError: a name is no candidate of this case, or a sensor's effect without its column.
        """
        return self._go_to((*self._present, *self.space.labels_to_add(names)))

    @one_thread_of_blas
    def drop(self, *names: str) -> Investigation:
        """Remove additions from the model, and return it.

        Raises:
            EffectError: a name is no candidate of this case.
        """
        gone = self.space.labels_of(names)
        return self._go_to(tuple(label for label in self._present if label not in gone))

    def undo(self) -> Investigation:
        """Return to the model before the last addition or removal; the base model stays."""
        self._path = self._path[:-1] or ((),)
        self._present = self._path[-1]
        return self

    @one_thread_of_blas
    def search(self, each: Callable[[], None] = lambda: None) -> policy.Found:
        """Add and remove automatically, from the present model on, until nothing more is found; what is there stays.

        Args:
            each: is called whenever the present model has changed; what it raises ends the search there.
        """

        def accepted(model: Settled) -> None:
            self._go_to(model.labels)
            each()

        return policy.run(self, self._present, each=accepted)

    def _go_to(self, labels: tuple[str, ...]) -> Investigation:
        model = self.settled(labels)
        self._present = model.labels
        self._path = (*self._path, self._present)
        return self

    @one_thread_of_blas
    def ladder(self) -> pd.DataFrame:
        """Return every model so far: its additions, and the RMS error of each channel on fit runs and on check runs."""
        rows = []
        for one in self.models():
            row: dict[str, object] = {"added": " + ".join(one.added) or "base"}
            for channel, error in one.errors.items():
                row |= {f"{channel} fit": error.fit, f"{channel} check": error.check}
            rows.append(row)
        return pd.DataFrame(rows)
