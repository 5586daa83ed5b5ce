"""`Investigation`: a diagnosis step by step.

investigation = Investigation(case)
investigation.errors()            # by run and channel, against noise and tolerance
investigation.where()             # where the present model fails, in sentences
investigation.regime_map("voltage_V")  # the same as means over ranges of two conditions
investigation.candidates()        # ranked effects, sensor faults and shifts of runs
investigation.preview("self_heating")  # the residual that it would leave, before any refit
investigation.add("self_heating")
investigation.drop("self_heating")
investigation.undo()
investigation.follow(path)        # to where another one was: its `path`
investigation.ladder()            # every model so far
investigation.to_xarray()         # the posterior of the present model, for ArviZ
"""

from __future__ import annotations

import dataclasses
import functools
import html
from collections.abc import Callable, Mapping, Sequence
from typing import Concatenate, ParamSpec, TypeVar

import pandas as pd
import xarray as xr

from jaxmodel.base.errors import MeasurementError, instead
from jaxmodel.base.progress import Stage, stages
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.extended import extended_case
from jaxmodel.diagnosis.findings import all_curves, run_found
from jaxmodel.diagnosis.plotting import InvestigationPlots
from jaxmodel.diagnosis.posterior import posterior_tree
from jaxmodel.diagnosis.residuals.regime_map import RegimeMap, regime_map
from jaxmodel.diagnosis.residuals.statements import statements
from jaxmodel.diagnosis.result import Rung
from jaxmodel.diagnosis.rungs import errors_by_run, residuals_of, rung
from jaxmodel.diagnosis.search import Found, Search
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.lanes import one_thread_of_blas
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.settings import SETTINGS, Settings

P = ParamSpec("P")
R = TypeVar("R")


def _shown(verb: Callable[Concatenate[Investigation, P], R]) -> Callable[Concatenate[Investigation, P], R]:
    """Show what a method does while it lasts, where the caller of the investigation wants it; BLAS has one thread."""

    @functools.wraps(verb)
    def method(self: Investigation, *args: P.args, **named: P.kwargs) -> R:
        with stages(self._progress, self.case.name) as tell:
            before, self._tell = self._tell, tell
            try:
                return verb(self, *args, **named)
            finally:
                self._tell = before

    return one_thread_of_blas(method)


class Investigation:
    """One case and its present model, at first the calibrated base model.

    Attributes:
        cache: of all models fitted so far; their numbers do not depend on the order of additions.
        searching: the automatic search over them.
    """

    def __init__(
        self,
        case: Case,
        *,
        without: Sequence[str] = (),
        settings: Settings = SETTINGS,
        progress: bool | Stage = True,
    ) -> None:
        """Begin with the calibrated base model.

        Args:
            case: with at least one fit run.
            without: names of effects that are ruled out.
            settings: the constants.
            progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what
                is done next.

        Raises:
            FitError: nothing is uncertain, no run may be used to calibrate, or there are no readings.
            EffectError: a name that is no candidate of this case.
        """
        self._progress: bool | Stage = progress
        self._tell: Stage = lambda now: None
        self.cache = FitCache(case, without=without, settings=settings, progress=lambda now: self._tell(now))
        self.searching = Search(self.cache)
        self._present: tuple[str, ...] = ()
        self._path: tuple[tuple[str, ...], ...] = ((),)

    @property
    def case(self) -> Case:
        """Return the case as it is fitted."""
        return self.cache.case

    @property
    def noise(self) -> Mapping[str, NoiseModel]:
        """Return the noise of every channel."""
        return self.cache.noise

    @property
    def model(self) -> Fit:
        """Return the present model."""
        return self._fit(self._present)

    def _fit(self, labels: tuple[str, ...]) -> Fit:
        """Return a model: with additions the curves of the stated tables are corrected too."""
        return self.cache.fit(labels) if labels else self.cache.calibrated

    @property
    def added(self) -> tuple[str, ...]:
        """Return the additions of the present model to the base model."""
        return self._present

    @property
    def path(self) -> tuple[tuple[str, ...], ...]:
        """Return the additions of each model on the way to the present one; `undo` goes back along it."""
        return self._path

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
            self._rungs[labels] = rung(self.cache, "", self._fit(labels))
        return self._rungs[labels]

    @_shown
    def present(self) -> Rung:
        """Return the present model's parameters, errors and predictions."""
        return dataclasses.replace(self._rung(self._present), name="present")

    @_shown
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

    @_shown
    def to_xarray(self, draws: int = 500) -> xr.DataTree:
        """Return the present model as draws of its posterior, in the groups of ArviZ.

        The draws are of the normal approximation at the best fit, and of no Markov chain; the attributes of the groups
        say so. The fitted runs are simulated for each.

        Args:
            draws: their number; memory is 16 bytes for each of them and each fitted reading.

        Returns:
            `posterior`: the numbers of `parameters` by name. `posterior_predictive`, `log_likelihood`, `observed_data`:
            by channel, over its fitted readings; a log score is per independent reading. `constant_data`: best fit,
            residual, and sd and readings for each independent one of the weights.

        Example:
            >>> from jaxmodel import Investigation, read_case
            >>> tree = Investigation(read_case("examples/samsung_30q"), progress=False).to_xarray(draws=200)
            >>> tree["posterior/capacity_Ah"].dims, list(tree["log_likelihood"].data_vars)
            (('chain', 'draw'), ['voltage_V', 'cell_temperature_degC'])
        """
        self._tell("drawing from the posterior of the present model")
        return posterior_tree(self.cache, self.model, draws)

    def extended_case(self) -> Case:
        """Return the case with the parameters, effects and tables of the present model."""
        last, cache, labels = self.present(), self.cache, self._present
        shifts = [label for label in labels if cache.space.candidates[label].group == "run"]
        runs = [run_found(cache, self.model, last, label, {}) for label in shifts]
        return extended_case(self.case, last, all_curves(cache, self.model), runs)[0]

    def __repr__(self) -> str:
        return f"<Investigation of {self.case.name}: {' + '.join(self._present) or 'base model'}>"

    def _repr_html_(self) -> str:
        return f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>{self.ladder().to_html(index=False, border=0)}"

    @_shown
    def errors(self) -> pd.DataFrame:
        """Return the present model's errors: a row for each channel of each run, against noise and tolerance."""
        self._tell("calibrating the present model")
        return errors_by_run(self.cache, {"present": self.present()}).drop(columns="model")

    @_shown
    def where(self) -> pd.DataFrame:
        """Return where the present model fails: channel, sentence, and the share of the channel's mean square."""
        self._tell("looking where the present model fails")
        capacity = self.case.parameters.get("capacity_Ah")
        rows = [
            (residuals.channel, one.text, one.share)
            for residuals in residuals_of(self.cache, self.present())
            for one in statements(residuals, capacity_Ah=None if capacity is None else capacity.value)
        ]
        return pd.DataFrame(rows, columns=["channel", "sentence", "share"])

    @_shown
    def regime_map(self, channel: str) -> RegimeMap:
        """Return the present model's residual of one channel over ranges of the two conditions that place it best.

        Args:
            channel: as `errors` lists it.

        Raises:
            MeasurementError: no run has readings of this channel.
        """
        found = {residuals.channel: residuals for residuals in residuals_of(self.cache, self.present())}
        if channel not in found:
            raise MeasurementError(f"regime_map: there are no readings of '{channel}'.{instead(channel, found)}")
        return regime_map(found[channel])

    @_shown
    def candidates(self) -> pd.DataFrame:
        """Return the candidates, the best first by a linear estimate of their gain of log evidence.

        A gain of 3 is odds of 20 to 1; a candidate must gain more where many could explain the readings.
        """
        self._tell("scoring every candidate")
        rows = [
            (gain.label, self.cache.space.candidates[gain.label].group, gain.log_evidence, gain.chi2, gain.z)
            for gain in self.cache.scores(self._present).gains()
        ]
        return pd.DataFrame(rows, columns=["name", "group", "log_evidence", "chi2", "z"])

    @_shown
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
        self._tell("scoring every candidate")
        scores, data = self.cache.scores(self._present), self.cache.view.data
        outputs = self.case.vocabulary.outputs
        table = {
            "run": [self.case.runs[number].name for number in data.run],
            "channel": [outputs[number] for number in data.channel],
            "time_s": data.time_s,
            "residual": self.cache.fit(self._present).errors,
        }
        labels = self.cache.space.labels_of(names) if names else [gain.label for gain in scores.gains()]
        left = {label: scores.left_with(label) for label in labels}
        return pd.DataFrame(table | {label: one for label, one in left.items() if one is not None})

    @_shown
    def add(self, *names: str) -> Investigation:
        """Add effects, sensor faults, laws or shifts of single runs to the model, refit it, and return it.

        Args:
            names: as `candidates` lists them.

        Raises:
            EffectError: a name is no candidate of this case, that of a curve, or a sensor's effect without its column.
        """
        self._tell(f"refitting with {' and '.join(names)}")
        return self._go_to((*self._present, *self.cache.space.labels_to_add(names)))

    @_shown
    def drop(self, *names: str) -> Investigation:
        """Remove additions from the model, and return it.

        Raises:
            EffectError: a name is no candidate of this case.
        """
        gone = self.cache.space.labels_of(names)
        self._tell(f"refitting without {' and '.join(names)}")
        return self._go_to(tuple(label for label in self._present if label not in gone))

    def undo(self) -> Investigation:
        """Return to the model before the last addition or removal; the base model stays."""
        self._path = self._path[:-1] or ((),)
        self._present = self._path[-1]
        return self

    def follow(self, path: Sequence[Sequence[str]]) -> Investigation:
        """Go to the last model of a path, and return it; models on it are fitted when they are looked at.

        Args:
            path: as `path` returned it, perhaps of an earlier investigation of the same case.

        Raises:
            EffectError: as of `add`.
        """
        self._path = tuple(self.cache.space.labels_to_add(labels) for labels in path) or ((),)
        self._present = self._path[-1]
        return self

    @_shown
    def search(self, each: Callable[[], None] = lambda: None) -> Found:
        """Add and remove automatically, from the present model on, until nothing more is found; what is there stays.

        Args:
            each: is called whenever the present model has changed; what it raises ends the search there.
        """

        def accepted(labels: tuple[str, ...]) -> None:
            self._go_to(labels)
            each()

        return self.searching.run(self._present, each=accepted)

    def _go_to(self, labels: tuple[str, ...]) -> Investigation:
        self._present = self.cache.fit(labels).added
        self._path = (*self._path, self._present)
        return self

    @_shown
    def ladder(self) -> pd.DataFrame:
        """Return every model so far: its additions, and the RMS error of each channel on fit runs and on check runs."""
        rows = []
        for one in self.models():
            row: dict[str, object] = {"added": " + ".join(one.added) or "base"}
            for channel, error in one.errors.items():
                row |= {f"{channel} fit": error.fit, f"{channel} check": error.check}
            rows.append(row)
        return pd.DataFrame(rows)
