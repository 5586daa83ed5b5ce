"""What a user may add to a model by name."""

from __future__ import annotations

import pytest

from jaxmodel.base.errors import EffectError
from jaxmodel.diagnosis.investigation import Investigation


@pytest.mark.parametrize("name", ["ocv_curve", "series_resistance_curve"])
def test_a_curve_is_in_every_model_and_cannot_be_added(plain_small: Investigation, name: str):
    with pytest.raises(EffectError, match=f"^'{name}' is a curve, and a diagnosis fits all curves by itself"):
        plain_small.add("self_heating", name)
    assert plain_small.added == ()


def test_laws_shifts_and_faults_of_a_column_are_added_by_their_names(plain_small: Investigation):
    space = plain_small.cache.space
    for name in ("overpotential(current_A)", "contact_resistance@run-02", "voltage_offset:voltage_V", "self_heating"):
        assert space.labels_to_add([name]) == (name,)
