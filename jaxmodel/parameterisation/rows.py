"""The runs of a cell as arrays: charge, temperature, and long runs thinned by a stated rule."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case.records import Run

MOST_ROWS = 60_000  # of a run before it is thinned
MERGED_S, MERGED_V, MERGED_SHARE = 10.0, 0.001, 0.01  # longest merged step; changes below which rows are merged
RESTING_SHARE = 0.005  # of the largest current: below it a cell rests


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """One run of a cell; every array has shape (rows,).

    Attributes:
        run: as the case has it.
        time_s: increasing times [s].
        current_A: over the step that ends at each row, positive on discharge.
        ambient_degC: of the surroundings.
        voltage_V: NaN where nothing was read.
        degC: of the cell: its thermometer, between readings straight; the ambient where there is none.
        drawn_Ah: charge drawn since the first row.
        warm: whether there is a thermometer on the cell.
    """

    run: Run
    time_s: np.ndarray
    current_A: np.ndarray
    ambient_degC: np.ndarray
    voltage_V: np.ndarray
    degC: np.ndarray
    drawn_Ah: np.ndarray
    warm: bool

    @property
    def name(self) -> str:
        """Return the name of the run."""
        return self.run.name

    @property
    def read(self) -> np.ndarray:
        """Return the mask of the rows with a voltage."""
        return np.isfinite(self.voltage_V)

    @property
    def resting_A(self) -> float:
        """Return the current below which the cell rests."""
        return RESTING_SHARE * float(np.max(np.abs(self.current_A))) + 1e-9


def rows_of(run: Run) -> Rows:
    """Return a run's arrays, thinned where it has more than `MOST_ROWS` rows.

    Rows are merged in pairs while the run is longer, where the current changes by less than `MERGED_SHARE` of the
    largest, the voltage by less than `MERGED_V`, and the step stays below `MERGED_S`. The merged row has the later
    time, voltage and temperature, and the mean current over both steps: charge and edges are kept.
    """
    measured = run.measured
    time_s, outputs = measured.time_s, measured.outputs
    current, ambient = measured.inputs["current_A"], measured.inputs["ambient_degC"]
    voltage = outputs.get("voltage_V", np.full(time_s.size, np.nan))
    read = outputs.get("cell_temperature_degC", np.full(time_s.size, np.nan))
    there = np.isfinite(read)
    warm = bool(there.any())
    degC = np.interp(time_s, time_s[there], read[there]) if warm else ambient
    columns = (time_s, current, ambient, voltage, degC)
    while columns[0].size > MOST_ROWS:
        thinner = _merged(columns)
        if thinner[0].size > 0.95 * columns[0].size:
            break
        columns = thinner
    time_s, current, ambient, voltage, degC = columns
    drawn = np.append(0.0, np.cumsum(np.diff(time_s) * current[1:])) / 3600.0
    return Rows(run, time_s, current, ambient, voltage, degC, drawn, warm)


def _merged(columns: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Return the columns with each second row merged into the next where both are alike."""
    time_s, current, _, voltage, _ = columns
    step = np.diff(time_s, prepend=time_s[0])
    drop = np.zeros(time_s.size, dtype=bool)
    pair = np.arange(1, time_s.size - 1, 2)
    alike = np.abs(current[pair + 1] - current[pair]) < MERGED_SHARE * np.max(np.abs(current))
    alike &= ~(np.abs(voltage[pair + 1] - voltage[pair]) >= MERGED_V)
    alike &= step[pair] + step[pair + 1] <= MERGED_S
    drop[pair[alike]] = True
    mean = current.copy()
    into = pair[alike] + 1
    mean[into] = (step[into] * current[into] + step[into - 1] * current[into - 1]) / (step[into] + step[into - 1])
    return tuple((mean if column is current else column)[~drop] for column in columns)
