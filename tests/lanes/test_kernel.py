"""Kernels of small functions against `jax.vmap` of the same."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxmodel import lanes
from jaxmodel.lanes import ROWS, STEPS, Kernel, NotNative, Pool, machine
from jaxmodel.model.curves import Table, interpolate

LANES = 37
RNG = np.random.default_rng(0)
LONG = RNG.normal(size=900)
TABLE = RNG.normal(size=(40, 30))


def run(kernel: Kernel, shared, own, count: int = LANES, threads: int = 1, packets: int = 1):
    with Pool(threads) as pool:
        return pool.start(kernel, shared, own, count, packets).tree()


def scanned(shared, x):
    """A recursion over a long array, kept at every step, with what is read from it afterwards."""

    def advance(carry, given):
        value, most = carry
        value = 0.9 * value + jnp.sin(given) * x["gain"]
        return (value, jnp.maximum(most, value)), value

    (last, most), kept = lax.scan(advance, (x["start"], x["start"]), shared["over"])
    rows = jnp.concatenate([x["start"][None], kept])[shared["rows"]]
    return {"last": last, "most": most, "rows": rows, "scaled": jnp.exp(rows) * x["gain"], "sum": jnp.sum(kept)}


def rooted(shared, x):
    """Newton's method, each lane as many steps as it needs."""

    def goes_on(state):
        value, count = state
        return (jnp.abs(value**2 - x["of"]) > 1e-13 * x["of"]) & (count < 50)

    def improve(state):
        value, count = state
        return 0.5 * (value + x["of"] / value), count + 1

    return lax.while_loop(goes_on, improve, (jnp.ones(()), jnp.asarray(0)))


def on_small_arrays(shared, x):
    """Products, sums, parts and orders of arrays of a lane."""
    matrix = x["matrix"] + shared["of_all"]
    return {
        "product": matrix @ jnp.ones(3) + jnp.dot(x["vector"], x["vector"]),
        "sum": jnp.sum(matrix, axis=0) + jnp.cumsum(x["vector"])[::-1],
        "most": jnp.max(matrix) + jnp.min(matrix, axis=1)[1],
        "moved": jnp.concatenate([matrix[1:], x["vector"][None]]).T,
        "padded": jnp.pad(x["vector"], (1, 2)) + jnp.arange(6),
        "one": matrix[1, 2] + jnp.stack([x["vector"][0], x["vector"][2]])[1],
        "mixed": shared["mix"] @ x["of_mix"],
        "any": jnp.any(matrix > 1.0) | jnp.all(x["vector"] > 0.0),
    }


def looked_up(shared, x):
    """A value at a place that differs from lane to lane, in tables large and small."""
    place = jnp.clip(jnp.floor(x["at"]).astype(int), 0, 1199)
    small = jnp.asarray([1.0, 4.0, 9.0])[place % 3]
    return shared["table"].ravel()[place] + small + shared["table"][3, 4] + x["own"][place % 3]


def in_tables(shared, x):
    """Tables of one to three points, at a place of the lane and at those of all steps."""
    signal = jnp.cumsum(shared["spans"]) * x["rate"]
    tables = [(jnp.arange(float(count)), jnp.asarray([3.0, 1.0, 2.0])[:count] * x["rate"]) for count in (1, 2, 3)]
    of_lane = [interpolate(x["rate"], *table) for table in tables]
    of_steps = [jax.vmap(lambda s, table=table: interpolate(s, *table))(signal) for table in tables]
    return of_lane, [values + signal for values in of_steps]


def beyond(shared, x):
    """Places outside of arrays, which are held within them, and parts of rows."""
    place = jnp.floor(x["at"]).astype(int)
    held = shared["table"].ravel().at[place].get(mode="clip") + x["own"].at[place].get(mode="clip")
    row = lax.dynamic_slice(shared["table"], (place, 0), (1, 30))[0, 7]
    return held + row + lax.dynamic_slice(shared["table"], (60, 3), (2, 4))[1, 2]


def chosen(shared, x):
    """Branches, by a truth value and by a number."""
    two = lax.cond(x["at"] > 500.0, lambda y: y * 2.0, lambda y: y - 1.0, x["at"])
    three = lax.switch(x["which"], [lambda y: y, jnp.sqrt, lambda y: -y], x["at"])
    return two + three


def chosen_at_length(shared, x):
    """Branches that a packet runs only if a lane takes them, in a loop; one is not defined for the other's lanes."""

    def series(y):
        return sum(jnp.sin(k * y) / k**2 for k in range(1, 12)), jnp.stack([y, -y]), y > 0.5

    def roots(y):
        return sum(jnp.sqrt(-y / k) for k in range(1, 12)), jnp.stack([y, y * y]), y < -0.5

    def advance(value, _):
        of_one, pair, beyond = lax.cond(value > 0.0, series, roots, value)
        three = lax.switch(x["which"], [lambda y: y, lambda y: sum(y**k for k in range(9)), jnp.cos], 0.1 * of_one)
        return jnp.sin(3.0 * value + 0.01 * of_one + pair[1] + three) + 0.01 * beyond, of_one

    last, kept = lax.scan(advance, x["at"], length=600)
    return last, jnp.sum(kept)


def sought(shared, x):
    """What sensors do with a signal over a run: places by bisection, interpolation, sums, and numbers put in."""
    ends = jnp.cumsum(shared["spans"])
    signal = jnp.sin(ends * x["rate"])
    late = ends[shared["rows"]] - x["delay"]
    after = jnp.clip(jnp.searchsorted(ends, late), 0, ends.shape[0] - 1)
    put = signal.at[shared["rows"]].set(0.5 * late, unique_indices=True)
    return {
        "found": signal[after] * (late > 0.0),
        "between": jnp.interp(late, ends, put),
        "last": put[-1] + signal[0],
        "of_each": jax.vmap(lambda t: jnp.sum(jnp.concatenate([t[None], shared["spans"][:3] * x["rate"]]) ** 2))(late),
        "either": lax.cond(shared["on"], lambda: put * x["rate"], lambda: signal),
        "of_lane": lax.cond(x["delay"] > 0.0, lambda: put * x["rate"], lambda: signal),
    }


def read_at_every_step(shared, x):
    """A table of more points than are kept in registers, at what a scan has kept of each step."""

    def advance(carry, given):
        carry = carry + given * x["rate"]
        return carry, carry

    kept = lax.scan(advance, x["rate"], shared["spans"])[1]
    return jax.vmap(lambda at: interpolate(at, shared["knots"], shared["values"]))(kept)


def own(**arrays: np.ndarray) -> dict[str, np.ndarray]:
    return arrays


FUNCTIONS: dict[str, tuple[Callable, object, dict[str, np.ndarray]]] = {
    "scan": (
        scanned,
        {"over": LONG, "rows": np.arange(0, 901, 7)},
        own(start=RNG.normal(size=LANES), gain=RNG.uniform(0.1, 2.0, LANES)),
    ),
    "signals": (
        sought,
        {"spans": RNG.integers(1, 9, 700) / 8, "rows": np.arange(3, 700, 5), "on": np.array(True)},
        own(rate=RNG.uniform(0.1, 1.0, LANES), delay=RNG.uniform(-3.0, 3.0, LANES)),
    ),
    "while": (rooted, {}, own(of=10.0 ** RNG.uniform(-8, 8, LANES))),
    "arrays": (
        on_small_arrays,
        {"of_all": RNG.normal(size=(4, 3)), "mix": RNG.normal(size=(12, 14))},
        own(
            matrix=RNG.normal(size=(LANES, 4, 3)),
            vector=RNG.normal(size=(LANES, 3)),
            of_mix=RNG.normal(size=(LANES, 14)),
        ),
    ),
    "tables": (
        looked_up,
        {"table": TABLE},
        own(at=RNG.uniform(-5.0, 1300.0, LANES), own=RNG.normal(size=(LANES, 3))),
    ),
    "small tables": (
        in_tables,
        {"spans": RNG.uniform(0.0, 0.01, 600)},
        own(rate=RNG.uniform(0.1, 1.0, LANES)),
    ),
    "a long table at every step": (
        read_at_every_step,
        {"spans": RNG.uniform(0.0, 0.01, 600), "knots": np.linspace(0.0, 3.0, 170), "values": RNG.normal(size=170)},
        own(rate=RNG.uniform(0.1, 1.0, LANES)),
    ),
    "places outside": (
        beyond,
        {"table": TABLE},
        own(at=RNG.uniform(-1e5, 1e5, LANES), own=RNG.normal(size=(LANES, 3))),
    ),
    "long branches": (
        chosen_at_length,
        {},
        own(at=RNG.uniform(-1.0, 1.0, LANES), which=np.sort(RNG.integers(0, 3, LANES))),
    ),
    "branches": (chosen, {}, own(at=RNG.uniform(0.0, 1e3, LANES), which=RNG.integers(0, 3, LANES))),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_kernel_does_what_vmap_does(name: str) -> None:
    function, shared, lanes = FUNCTIONS[name]
    wanted = jax.vmap(function, in_axes=(None, 0))(jax.tree.map(jnp.asarray, shared), lanes)
    found = run(Kernel(function, shared, jax.tree.map(lambda x: x[0], lanes)), shared, lanes)
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-13, atol=1e-13), found, wanted)
    jax.tree.map(lambda x, y: np.testing.assert_equal((x.dtype, x.shape), (y.dtype, y.shape)), found, wanted)


@pytest.mark.parametrize("on", [True, False])
def test_one_kernel_serves_runs_of_any_length(on: bool) -> None:
    _, _, lanes = FUNCTIONS["signals"]
    whole = np.dtype(int)
    shapes = {
        "spans": jax.ShapeDtypeStruct((STEPS,), float),
        "rows": jax.ShapeDtypeStruct((ROWS - 1,), whole),
        "on": jax.ShapeDtypeStruct((), bool),
    }
    kernel = Kernel(sought, shapes, jax.tree.map(lambda x: x[0], lanes), sizes=(STEPS, ROWS))
    for steps, rows in ((40, 12), (3000, 1001)):
        shared = {
            "spans": RNG.integers(1, 9, steps) / 8,
            "rows": np.sort(RNG.choice(steps, rows - 1, replace=False)),
            "on": np.array(on),
        }
        wanted = jax.vmap(sought, in_axes=(None, 0))(jax.tree.map(jnp.asarray, shared), lanes)
        with Pool(2) as pool:
            found = pool.start(kernel, shared, lanes, LANES, 1, (steps, rows)).tree()
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12), found, wanted)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_tables_over_temperature_are_read_at_steps_of_any_number(count: int) -> None:
    heights = np.array([[3.0, 1.0, 2.0], [2.0, 5.0, 1.0], [4.0, 0.0, 3.0]])[:count]

    def read(shared, x):
        table = Table(jnp.arange(3.0), heights * x["rate"], 10.0 * jnp.arange(count))
        soc = jnp.cumsum(shared["spans"]) * x["rate"]
        return jax.vmap(table)(soc, 9.0 * soc)

    lanes, shapes = own(rate=RNG.uniform(0.1, 1.0, LANES)), {"spans": jax.ShapeDtypeStruct((STEPS,), float)}
    kernel = Kernel(read, shapes, jax.tree.map(lambda x: x[0], lanes), sizes=(STEPS, ROWS))
    shared = {"spans": RNG.uniform(0.0, 0.2, 40)}
    wanted = jax.vmap(read, in_axes=(None, 0))(jax.tree.map(jnp.asarray, shared), lanes)
    with Pool(2) as pool:
        found = pool.start(kernel, shared, lanes, LANES, 1, (40, 12)).tree()
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["scan", "long branches"])
def test_bits_depend_neither_on_threads_nor_on_the_cut(name: str) -> None:
    function, shared, lanes = FUNCTIONS[name]
    kernel = Kernel(function, shared, jax.tree.map(lambda x: x[0], lanes))
    whole = run(kernel, shared, lanes, threads=2, packets=2)
    alone = [run(kernel, shared, jax.tree.map(lambda x, n=n: x[n : n + 1], lanes), count=1) for n in range(LANES)]
    together = jax.tree.map(lambda *parts: np.concatenate(parts), *alone)
    jax.tree.map(np.testing.assert_array_equal, whole, together)


def test_a_lane_that_is_not_finite_harms_no_other() -> None:
    lanes = {"of": np.array([2.0, np.nan, 3.0])}
    kernel = Kernel(rooted, {}, {"of": np.float64(0.0)})
    value, rounds = run(kernel, {}, lanes, count=3)
    np.testing.assert_allclose(value[[0, 2]], np.sqrt([2.0, 3.0]), rtol=1e-15)
    assert rounds[1] == 0  # its condition never holds


def test_shared_values_are_read_when_the_kernel_runs() -> None:
    function, shared, lanes = FUNCTIONS["scan"]
    kernel = Kernel(function, shared, jax.tree.map(lambda x: x[0], lanes))
    first = run(kernel, shared, lanes)
    second = run(kernel, shared | {"over": 0.0 * LONG}, lanes)
    assert np.all(first["last"] != second["last"])
    np.testing.assert_allclose(second["last"], lanes["start"] * 0.9**900, rtol=1e-12)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (jnp.sort, 'the operation "sort"'),
        (lambda x: jnp.abs(x + 1j), "a step of the function"),
        (lambda x: jnp.arange(900.0).at[x.astype(int)].get(mode="fill"), "fills what is outside"),
        (lambda x: jnp.linalg.inv(x[None, :2] * x[:2, None] + jnp.eye(2)), "the operation"),
        (lambda x: jnp.sum(jnp.outer(x, jnp.arange(600.0))), "steps"),
    ],
)
def test_what_has_no_instructions_is_named(function: Callable, message: str) -> None:
    with pytest.raises(NotNative, match=message):
        Kernel(lambda _, x: function(x), (), np.zeros(5))


def test_compiled_code_is_kept_and_a_broken_file_is_not_used(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("jaxmodel.base.cache._folder", lambda: tmp_path)
    compiled = []
    real = machine._compiled
    monkeypatch.setattr(machine, "_compiled", lambda text: compiled.append(text) or real(text))

    def double() -> np.ndarray:
        return run(Kernel(lambda _, x: 2.0 * x, (), np.float64(0.0)), (), np.arange(3.0), count=3)

    double()
    np.testing.assert_array_equal(double(), [0.0, 2.0, 4.0])
    assert len(compiled) == 1
    (file,) = tmp_path.rglob("*.o")
    file.write_bytes(file.read_bytes()[:-5] + b"wrong")
    np.testing.assert_array_equal(double(), [0.0, 2.0, 4.0])
    assert len(compiled) == 2


def test_front_door_names_what_it_has() -> None:
    of_processors = {"ROWS", "STEPS", "Kernel", "NotNative", "Pool", "Written", "over", "processor"}
    assert set(lanes.__all__) == of_processors | {"CudaCall", "CudaError", "CudaKernel"}
