"""The deficiency map: an unknown law is found where it acts, and a right model leaves nothing."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.misfit import FAMILYWISE, Block, Leftover, deficiency_map, law_unit

ROWS = 1500
CHANNELS = ("voltage_V", "cell_temperature_degC")
SD = np.array([2e-3, 0.1])


def made(seed: int, law=None, channel: int = 0, base_columns: int = 3) -> tuple[dict, dict[str, np.ndarray]]:
    """Whitened residuals of two channels with a hidden law on one of them, and what a base model could imitate."""
    rng = np.random.default_rng(seed)
    channel_of = np.repeat([0, 1], ROWS)
    scale = SD[channel_of]
    soc = np.tile(np.linspace(1.0, 0.2, ROWS), 2)
    current = np.repeat(rng.uniform(-2.0, 5.0, 2 * ROWS // 20), 20)
    variables = {"soc": soc, "current_A": current, "ambient_degC": np.repeat(rng.choice([0.0, 20.0], 30), 100)}
    error = rng.standard_normal(2 * ROWS)
    if law is not None:
        error = error + np.where(channel_of == channel, law(variables), 0.0) / scale
    base = rng.standard_normal((2 * ROWS, base_columns))
    base[:, 0] = np.where(channel_of == 0, current, 0.0) / scale  # a resistance: what it imitates is no law
    rows = {
        "base": np.concatenate([base, np.eye(base_columns)]),
        "residual": np.concatenate([error, np.zeros(base_columns)]),
        "channel_of": channel_of,
        "channels": CHANNELS,
        "whiten": lambda columns, mine: columns / scale[mine][:, None],
        "variables": variables,
        "multipliers": {"": np.ones(2 * ROWS), "current_A": current},
    }
    return rows, variables


def blocks_of(base, residual, channel_of, **rest) -> list[Block]:
    return deficiency_map(Leftover(base, residual, channel_of), **rest)


def strongest(**rows) -> Block:
    return blocks_of(**rows)[0]


def test_a_resistance_that_grows_at_low_charge_is_found_with_its_law() -> None:
    def law(v):
        return -0.02 * v["current_A"] * np.maximum(0.5 - v["soc"], 0.0)

    rows, _ = made(0, law)
    block = strongest(**rows)
    assert (block.channel, block.multiplier, block.variable) == ("voltage_V", "current_A", "soc")
    assert block.significant
    # The law itself, up to the constant resistance that the base model may put in its place.
    expected = -0.02 * np.maximum(0.5 - block.knots, 0.0)
    np.testing.assert_allclose(block.law - block.law[-1], expected - expected[-1], atol=1e-3)
    assert "voltage_V in proportion to current_A as a function of soc" in block.sentence()


def test_a_law_on_another_channel_is_not_laid_at_the_first() -> None:
    rows, _ = made(1, lambda v: 0.5 * (v["soc"] - 0.6) ** 2, channel=1)
    block = strongest(**rows)
    assert (block.channel, block.multiplier, block.variable) == ("cell_temperature_degC", "", "soc")
    assert block.significant


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ([0.0, 0.5, 2.0], "rising by 2 Ohm over 0.2 to 1"),
        ([2.0, 0.5, 0.5], "falling by 1.5 Ohm over 0.2 to 1"),
        ([1.0, -0.5, 2.0], "rising and falling between -0.5 Ohm at 0.6 and 2 Ohm at 1 over 0.2 to 1"),
    ],
)
def test_a_law_is_said_to_rise_or_fall_only_where_it_does_nothing_else(law: list[float], said: str) -> None:
    block = Block("voltage_V", "", "soc", 9.0, 3, 1e-9, np.array([0.2, 0.6, 1.0]), np.array(law), unit="Ohm")
    assert block.sentence().endswith(said)


@pytest.mark.parametrize(
    ("channel", "multiplier", "unit"),
    [("V", "current_A", "V/A"), ("degC", "", "K"), ("V", "", "V"), ("A", "soc", "A/unit of soc")],
)
def test_a_law_has_the_unit_of_what_it_adds_for_each_unit_of_what_multiplies_it(channel, multiplier, unit) -> None:
    assert law_unit(channel, multiplier) == unit


def test_what_the_base_model_imitates_is_no_law() -> None:
    rows, _ = made(2, lambda v: 0.01 * v["current_A"])
    assert not strongest(**rows).significant


@pytest.mark.parametrize("seed", range(3, 9))
def test_a_right_model_leaves_nothing(seed: int) -> None:
    rows, _ = made(seed)
    blocks = blocks_of(**rows)
    assert not any(block.significant for block in blocks)
    assert all(0.0 <= block.p_value <= 1.0 for block in blocks)


def test_p_values_are_those_of_the_ranks() -> None:
    """Over many right models the smallest corrected p-value falls below 5 % in about 5 % of them."""
    rng = np.random.default_rng(0)
    rows, _ = made(10)
    hits = []
    for _ in range(200):
        rows["residual"][: 2 * ROWS] = rng.standard_normal(2 * ROWS)
        hits.append(min(block.p_value for block in blocks_of(**rows)) < 0.05)
    assert np.mean(hits) <= 0.09  # Bonferroni over correlated blocks: at most 5 %, here with 2.6 standard errors
    assert np.mean(hits) > 0.0
    assert FAMILYWISE < 0.05


def test_a_noise_sd_stated_too_small_is_no_law() -> None:
    """Errors half as large again as stated scatter; they follow nothing."""
    rows, _ = made(11)
    rows["residual"] = 1.5 * rows["residual"]
    assert not strongest(**rows).significant


@pytest.mark.parametrize("seed", range(14, 17))
def test_coloured_noise_is_no_law(seed: int) -> None:
    """Whitened with its correlation of 0.9, noise follows nothing; laws taken as if it were white would find it."""
    rows, _ = made(seed)
    kept, white = 0.9, rows["residual"][: 2 * ROWS]
    follows = np.arange(2 * ROWS) % ROWS > 0

    def whiten(columns: np.ndarray, mine: np.ndarray) -> np.ndarray:
        scaled = columns / SD[rows["channel_of"]][mine][:, None]
        before = np.roll(scaled, 1, axis=0)
        return np.where(follows[mine][:, None], (scaled - kept * before) / np.sqrt(1.0 - kept**2), scaled)

    blocks = blocks_of(**rows | {"whiten": whiten})
    assert not any(block.significant for block in blocks)

    # A law in it is found at its size, which columns that are not whitened would miss by far.
    law = 0.2 * np.maximum(0.5 - rows["variables"]["soc"], 0.0) * (rows["channel_of"] == 0)
    rows["residual"] = np.concatenate(
        [white + whiten(law[:, None], np.arange(2 * ROWS))[:, 0], rows["residual"][2 * ROWS :]]
    )
    block = strongest(**rows | {"whiten": whiten})
    assert (block.channel, block.multiplier, block.variable) == ("voltage_V", "", "soc")
    expected = 0.2 * np.maximum(0.5 - block.knots, 0.0)
    np.testing.assert_allclose(block.law - block.law[-1], expected - expected[-1], atol=6e-3)


def test_a_variable_is_not_multiplied_by_itself() -> None:
    rows, _ = made(12)
    assert all(block.multiplier != block.variable for block in blocks_of(**rows))


def test_a_constant_variable_makes_no_block() -> None:
    rows, variables = made(13)
    variables["ambient_degC"] = np.full(2 * ROWS, 20.0)
    assert {block.variable for block in blocks_of(**rows)} == {"soc", "current_A"}
