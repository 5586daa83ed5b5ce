"""The benchmark for people: tables at the terminal, a JSON with the machine's details, and a plot."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import jax
import matplotlib.pyplot as plt

from jaxmodel.app.terminal import table

_PACKAGES = ("jax", "jaxlib", "numpy", "equinox", "diffrax")
_COLOURS = {"cell": "tab:blue", "robot": "tab:orange"}


def _version(package: str) -> str:
    """Return the version of a package; peers are not always installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def machine() -> dict[str, Any]:
    """Return what the figures depend on: processor, cores, compiler, versions."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    try:
        compiler = subprocess.run(["cc", "--version"], capture_output=True, text=True).stdout.split("\n")[0]
    except FileNotFoundError:
        compiler = "none"
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": jax.device_count(),
        "load_average": os.getloadavg(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compiler": compiler,
        "packages": {name: _version(name) for name in _PACKAGES},
    }


def print_against_c(title: str, rows: list[dict[str, Any]]) -> None:
    """Print ours against C, a line for each row."""
    columns = [
        "kind",
        "lanes",
        "steps",
        "cores",
        "ours, ns",
        "C, ns",
        "ours / C",
        "of core time",
        "SOC apart",
        "V apart",
    ]
    lines = []
    for row in rows:
        start = [row["kind"], f"{row['lanes']:,}", f"{row['steps']:,}", str(row["cores"])]
        start.append(f"{row['ours']['ns_per_lane_step']:.1f}")
        if "left_out" in row:
            lines.append([*start, row["left_out"], "", "", "", ""])
            continue
        end = [f"{row['c']['ns_per_lane_step']:.1f}", f"{row['ratio']:.2f}", f"{row['ratio_cpu']:.2f}"]
        lines.append([*start, *end, *(f"{apart:.0e}" for apart in row["apart"].values())])
    table(f"{title} (ns per lane and step, best run)", columns, lines, right=range(1, 10))
    for row in rows:
        if "xla" in row:
            times = ", ".join(
                f"{what} {row[name]['cpu_ns_per_lane_step']:.1f}"
                for name, what in (
                    ("ours", "ours"),
                    ("float32", "in float32"),
                    ("xla", "through XLA"),
                    ("c", "C"),
                    ("c_float32", "C in float32"),
                )
            )
            print(f"{row['kind']}, ns of core time per lane and step: {times}")


def print_equal_accuracy(rows: list[dict[str, Any]]) -> None:
    """Print the contestants at equal accuracy."""
    columns = ["solver", "at", "SOC error", "V error", "lanes", "us per lane, best", "median", "times ours"]
    lines = []
    for row in rows:
        if "left_out" in row:
            lines.append([row["name"], f"left out: {row['left_out']}", *[""] * 6])
            continue
        errors = (f"{error:.0e}" for error in row["errors"].values())
        times = (f"{row[name]:,.3g}" for name in ("us_per_lane", "median_us_per_lane", "times_ours"))
        lines.append([row["name"], row["setting"], *errors, f"{row['lanes']:,}", *times])
    table("Cells at constant current, 1,800 s, SOC to 1e-6 and voltage to 0.1 mV", columns, lines, right=range(2, 8))


def print_growth(found: dict[str, list[dict[str, Any]]]) -> None:
    """Print how a whole sweep grows."""
    lines = [
        [f"{row['lanes']:,}", f"{row['foretold_s']:.3g}", f"{row['measured_s']:.3g}", f"{row['ratio']:.2f}"]
        for row in found["lanes"]
    ]
    columns = ["lanes", "foretold, s", "measured, s", "measured / foretold"]
    table("A sweep of cells to disk, 60 steps", columns, lines, right=range(4))
    lines = [[str(row["workers"]), f"{row['measured_s']:.3g}"] for row in found["workers"]]
    table("The same by workers on this machine, 4 million lanes", ["workers", "s"], lines, right=range(2))


def print_commands(rows: list[dict[str, Any]]) -> None:
    """Print what the commands take."""
    lines = [[row["name"], f"{row['cold_s']:.1f}", f"{row['warm_s']:.1f}"] for row in rows]
    table("Whole commands by the clock", ["command", "cold, s", "warm, s"], lines, right=range(1, 3))


def print_accelerator(found: dict[str, Any]) -> None:
    """Print what a step of a lane takes on a GPU."""
    if "left_out" in found:
        print(f"The GPU is left out: {found['left_out']}.")
        return
    lines = []
    for row in found["sweeps"] + [{"kind": "Lorenz"} | row for row in found["lorenz"]]:
        times = [f"{1e3 * row[who]['ns_per_lane_step']:.1f}" if who in row else "" for who in ("cuda", "xla")]
        lines.append([row["kind"], row["precision"], f"{row['lanes']:,}", f"{row['steps']:,}", *times])
    columns = ["kind", "precision", "lanes", "steps", "CUDA kernel, ps", "XLA, ps"]
    table(f"Per lane and step, {found['gpu']}", columns, lines, right=range(2, 6))


def print_derivatives(found: dict[str, Any]) -> None:
    """Print what each way to the derivatives of one number by all parameters costs, and how far it is off."""
    columns = ["kind", "way", "lanes", "runs", "time, in runs", "of core time", "per parameter", "MiB", "error"]
    lines = []
    for row in found["cost"]:
        each = row["times_run_cpu"] / row["parameters"]
        error = "" if row["error"] is None else f"{row['error']:.0e}"
        runs = "" if row["runs"] is None else str(row["runs"])
        times = [f"{row['times_run']:.1f}", f"{row['times_run_cpu']:.1f}", f"{each:.2f}"]
        memory = "" if row["memory_MiB"] is None else f"{row['memory_MiB']:.0f}"
        lines.append([row["kind"], row["way"], f"{row['lanes']:,}", runs, *times, memory, error])
    first = found["cost"][0]
    table(
        f"Derivatives of one number by all parameters, {first['steps']:,} steps",
        columns,
        lines,
        right=range(2, 9),
    )
    long = found["long_gradient"]
    print(f"A gradient through {long['steps']:,} steps: {long['peak_MiB']:.0f} MiB, the whole process.")


def write(folder: Path, results: dict[str, Any]) -> None:
    """Write results.json and results.png."""
    (folder / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    figure, panels = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    for panel, name, axis, label in (
        (panels[0], "over_lanes", "lanes", "lanes, 1,800 steps"),
        (panels[1], "over_steps", "steps", "steps, 4,096 lanes or fewer"),
    ):
        for kind, colour in _COLOURS.items():
            rows = [row for row in results[name] if row["kind"] == kind]
            for who, style in (("ours", "o-"), ("c", "s--")):
                some = [row for row in rows if who in row]
                y = [row[who]["ns_per_lane_step"] for row in some]
                text = f"{kind}, {'C by hand' if who == 'c' else 'ours'}"
                panel.loglog([row[axis] for row in some], y, style, color=colour, label=text)
        panel.set(xlabel=label, ylabel="ns per lane and step")
        panel.grid(alpha=0.3, which="both")
    panels[0].legend(frameon=False)
    places, names, heights = [], [], []
    for row in results["against_c"]:
        if "ratio" in row:
            places.append(len(places))
            names.append(f"{row['kind']}\n{row['cores']} core{'s' if row['cores'] > 1 else ''}")
            heights.append(row["ratio"])
    panels[2].bar(places, heights, color=[_COLOURS[name.split("\n")[0]] for name in names])
    panels[2].axhline(1.3, color="black", linestyle=":", label="goal 1.3")
    panels[2].set_xticks(places, names)
    panels[2].set(ylabel="time of ours / time of C, 4,096 lanes")
    panels[2].set_ylim(0.0, 1.6)  # room for the goal's name above its line
    panels[2].legend(frameon=False, loc="upper left")
    figure.savefig(folder / "results.png", dpi=110)
    plt.close(figure)
