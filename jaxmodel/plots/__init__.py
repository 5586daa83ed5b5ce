"""Pictures for reports: each function returns a matplotlib Figure, ready for print, and changes no global setting.

    from jaxmodel import plots, sweeps

    dataset = sweeps.run(study)
    plots.heat_map(dataset, "soc_gradient", "ambient_degC", "load_torque_Nm")
    plots.save_pictures(dataset, "results")  # everything that the command line draws of it

Results of a diagnosis draw themselves: `diagnosis.plot.ladder()`. What `__all__` lists is the public API.
"""

from typing import TYPE_CHECKING

from jaxmodel.base.lazy import names_when_used

if TYPE_CHECKING:
    from jaxmodel.plots.datasets import pictures_of, save_pictures
    from jaxmodel.plots.errors import errors_by_run
    from jaxmodel.plots.evidence import errors_of_models
    from jaxmodel.plots.pulses import pulse_by_pulse
    from jaxmodel.plots.runs import fit_and_residuals, residuals_by_condition, simulation
    from jaxmodel.plots.sensitivities import (
        doubling_beside_gradient,
        elasticities,
        elasticity_maps,
        interaction_matrix,
        over_time,
    )
    from jaxmodel.plots.style import LINES, new_figure, styled
    from jaxmodel.plots.sweeps import against_paper, family, heat_map, metric_curves
    from jaxmodel.plots.uncertainty import bands_over_time, metric_intervals

__all__ = [
    "LINES",
    "against_paper",
    "bands_over_time",
    "doubling_beside_gradient",
    "elasticities",
    "elasticity_maps",
    "errors_by_run",
    "errors_of_models",
    "family",
    "fit_and_residuals",
    "heat_map",
    "interaction_matrix",
    "metric_curves",
    "metric_intervals",
    "new_figure",
    "over_time",
    "pictures_of",
    "pulse_by_pulse",
    "residuals_by_condition",
    "save_pictures",
    "simulation",
    "styled",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
