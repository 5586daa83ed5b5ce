"""Every result that the paper prints, each with its place.

Specht et al., A Dynamic Model of the Effect of Ambient Temperature Variations on Lithium Battery Life when Powering
Brushed Permanent-Magnet Direct Current Motors (ES410, University of Warwick).
"""

from __future__ import annotations

import dataclasses

import numpy as np

# Table 1: change of the state of charge [1/s] by ambient [degC]; Table 2: by the torque of a motor [N m], at 20 degC.
TABLE_1 = {-20.0: -2.8e-4, 0.0: -2.5e-4, 20.0: -2.1e-4, 40.0: -1.6e-4, 60.0: -1.3e-4, 80.0: -0.9e-4, 100.0: -0.5e-4}
TABLE_2 = {0.175: -2.0e-4, 0.25: -2.8e-4, 0.3: -3.4e-4, 0.35: -3.8e-4}
TABLE_STEP = 0.1e-4  # 1/s, to which both tables are printed

# Section 3, under the tables: "about 0.33e-4 per 20 degC decrease", "0.5e-4 per 0.05 N m".
STEP_PER_20_K, STEP_PER_50_MNM = 0.33e-4, 0.5e-4

USABLE_CHARGE_AH = 4.2  # section 3: after 18 months

# Fig. 8, section 3: V/s of one cell at 0 N m and 20 degC.
CUBIC_GRADIENT = -5.8e-5  # third-order polynomial, "average gradient"; over which span is not said
LINEAR_GRADIENT = -0.15e-5  # yellow line; the text calls the curve linear between 30 and 1080 s
FIRST_ORDER_GRADIENT = -3.5e-5
LINEAR_SPAN_S = (30.0, 1080.0)
QUICK_DROP_V, AFTER_2000_S_V = 3.4, 3.2  # "drops down to 3.4 V quickly and depletes to about 3.2 V after 2000 s"

# Fig. 9, section 4: the yellow line with the equivalent circuit's components doubled.
DOUBLED_GRADIENT = -0.33e-5

TEST_DURATION_S = 1800.0  # section 4
REDUCTION = 0.15  # of the motor current in the compensated tests
VOLTMETER_V = 0.1
DROPS_SEEN_S = (750.0, 1000.0)  # "between 750 and 1000 seconds of test runtime"


@dataclasses.dataclass(frozen=True)
class Test:
    """One of the four tests of section 4: Tables 3 (pack, V), 4 (ohm) and 5 (V/s of one cell)."""

    ambient_degC: float
    compensated: bool
    initial_V: float
    final_V: float
    initial_ohm: float
    final_ohm: float
    gradient_V_s: float

    @property
    def name(self) -> str:
        """Its name in Table 5."""
        return f"{'c' if self.compensated else 'nc'} {self.ambient_degC:g} °C"


TESTS = (
    Test(20.0, False, 22.6, 22.4, 0.012, 0.04, -4.0e-5),
    Test(20.0, True, 22.6, 22.4, 0.012, 0.03, -3.4e-5),
    Test(30.0, False, 22.6, 22.5, 0.0055, 0.018, -1.7e-5),
    Test(30.0, True, 22.6, 22.6, 0.0055, 0.016, 0.0),
)


def cycle_ohm(cycles: float) -> float:
    """Return R_cyc of one cell in ohm, eq. 7."""
    return 0.0015 * float(np.sqrt(cycles))


def share_left(months: float, storage_degC: float) -> float:
    """Return the share of the capacity left after storage, eq. 8."""
    return 1.0 - 1.544e5 * float(np.exp(-40498.0 / (8.3143 * (storage_degC + 273.15)))) * months


@dataclasses.dataclass(frozen=True)
class Headline:
    """A change of the slope along a table, per step of its axis, and as a share of one of its slopes.

    Attributes:
        per_interval: from the table's ends, over its intervals.
        per_row: the same difference over the number of its rows instead.
        reference: the slope that the share is taken of.
    """

    per_interval: float
    per_row: float
    reference: float

    @property
    def share(self) -> float:
        """The change per interval by the reference."""
        return abs(self.per_interval / self.reference)

    @property
    def share_by_rows(self) -> float:
        """The change per row by the reference."""
        return abs(self.per_row / self.reference)


def headline(table: dict[float, float], step: float, reference_at: float) -> Headline:
    """Return how the slopes of a table change per `step` of its axis, by its slope at `reference_at`.

    The paper's 15.7 % is 0.33e-4 / 2.1e-4, and 0.33e-4 is the whole change of Table 1 (2.3e-4) by its seven rows, not
    by its six intervals. Its 14.7 % is 0.5e-4 / 3.4e-4: the change per 50 mN m, rounded, by the slope at 300 mN m.
    """
    places, slopes = np.array(list(table)), np.array(list(table.values()))
    change = slopes[-1] - slopes[0]
    intervals = (places[-1] - places[0]) / step
    return Headline(change / intervals, change / (intervals + 1.0), table[reference_at])
