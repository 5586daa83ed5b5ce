"""Good files of every form that the product reads, small enough to be read thousands of times."""

from __future__ import annotations

import io
import json

import pandas as pd
import scipy.io

from jaxmodel.operation.kalman import Tuning
from jaxmodel.operation.state_of_charge import FILTER, FILTER_FIXED
from tests.conftest import REPOSITORY
from tests.data.importing.benches import FORMATS, cell_log, motor_log
from tests.data.tables.made_logs import flight, flight_text, lvm

CASE = """title = "Small cell"
kind = "cell"
preset = "paper"

[parameters]
capacity_Ah = { value = 3.0, sd = 0.03 }
storage_months = 0
initial_soc = 0.9

[parameters.ocv]
soc = [0.0, 0.5, 1.0]
voltage_V = [3.0, 3.7, 4.2]
sd_V = 0.01

[parameters.R_ints]
soc = [0.0, 1.0]
temperature_degC = [0.0, 40.0]
ohm = [[0.05, 0.04], [0.03, 0.02]]

[effects]
self_heating = { C_th = 80.0, hA = { value = 0.1, sd = 0.01 } }
temperature_offset = { column = "cell_temperature_degC" }

[sensors]
voltage_V = 0.001

[tolerance]
voltage_V = { rms = 0.01, max = 0.03 }

[cutoff]
soc = 0.05
voltage_V = 2.5

[[runs]]
file = "one.csv"
split = "fit"
label = "2 A"
initial_soc = { value = 0.95, sd = 0.01 }

[[runs]]
file = "two.csv"
split = "check"
ambient_degC = 20
initial_cell_temperature_degC = 21.5
tolerance = { voltage_V = 0.02 }
cycles = 30
"""
ONE = "# of a bench\ntime_s,current_A,ambient_degC,voltage_V,cell_temperature_degC\n" + "".join(
    f"{10 * n},{2.0 + 0.1 * (n % 3):g},20.5,{4.1 - 0.002 * n:.4f},{20.5 + 0.01 * n:.2f}\n" for n in range(40)
)
TWO = "time_s,current_A,voltage_V\n" + "".join(f"{n},1.5,{4.0 - 0.001 * n:.4f}\n" for n in range(20))
STUDY = """title = "Small study"
kind = "robot"
metrics = ["final_soc", "delivered_energy_Wh"]
store = ["soc"]
store_every = 5

[parameters]
storage_months = 0

[effects]
self_heating = { C_th = 80.0 }

[profile]
duration_s = 60
step_s = 5
ambient_degC = 20.0
incline_deg = 3.0
pulses.duty = { high = 0.5, low = 0.1, on_s = 10, period_s = 20, start_s = 5 }

[axes]
cycles = [0, 100]
capacity_Ah = { start = 2.0, stop = 5.0, count = 4 }
"self_heating.hA" = { start = 0.1, stop = 1.0, count = 3, spacing = "log" }

[sample]
method = "sobol"
count = 8
seed = 1
ranges = { k_tau = [0.03, 0.05], R_0 = { low = 0.1, high = 0.2, spacing = "log" } }

[cutoff]
soc = 0.2
"""
OF_CASE = """case = "case.toml"
[profile]
csv = "one.csv"
repeat = 3
scale = { current_A = 0.5 }
[axes]
cycles = { start = 0, stop = 100, step = 25 }
"scale.current_A" = [0.5, 1.5]
"initial.soc" = [0.8, 0.9]
"""
DRIVE = """kind = "robot"
fidelity = "lut"
[profile]
step_s = 2
repeat = 2
ambient_degC = 15
mission = [{ duration_s = 20, speed_m_s = 0.1, incline_deg = 5 }, { duration_s = 10, speed_m_s = 0, incline_deg = 0 }]
[axes]
cycles = [0, 10]
"""
PRESET_CASE = CASE.replace('"paper"', '"own.toml"')
TUNING = json.dumps({name: dict.fromkeys(Tuning.__dataclass_fields__, 0.01) for name in (FILTER, FILTER_FIXED)})


def _file(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


def _written(write: str, frame: pd.DataFrame) -> bytes:
    stream = io.BytesIO()
    if write == "mat":
        scipy.io.savemat(stream, {"meas": {name: frame[name].to_numpy() for name in frame}})
    elif write == "xlsx":
        frame.to_excel(stream, index=False)
    else:
        getattr(frame, f"to_{write}")(stream)
    return stream.getvalue()


def text_logs() -> dict[str, bytes]:
    """Return what cyclers export, by file name."""
    log = cell_log(step_s=60.0)
    made = {name: of(log) for name, of in FORMATS.items()}
    made |= {"bench.lvm": lvm("No"), "segments.lvm": lvm("Multi", segments=2), "flight.log": flight_text(cells=1)}
    return {name: content.encode("utf-8") if isinstance(content, str) else content for name, content in made.items()}


def binary_logs() -> dict[str, bytes]:
    """Return the same log in formats that are no text."""
    log = cell_log(step_s=60.0).rename(columns={"temperature_degC": "T_degC"})
    made = {f"log.{suffix}": _written(suffix, log) for suffix in ("xlsx", "parquet", "feather", "mat")}
    return made | {"flight.bin": flight(cells=1)[:60_000]}


def motor_csv() -> bytes:
    """Return the log of a motor."""
    return motor_log(step_s=0.1).to_csv(index=False).encode()


def folders() -> dict[str, dict[str, bytes]]:
    """Return folders of text files by what reads them; the first file of each is named to the reader."""
    texts = {
        "case": {"case.toml": CASE, "one.csv": ONE, "two.csv": TWO},
        "preset": {"case.toml": PRESET_CASE, "own.toml": _file("jaxmodel/case/presets/lg_mj1.toml"), "one.csv": ONE,
                   "two.csv": TWO},
        "study": {"study.toml": STUDY},
        "study of a case": {"study.toml": OF_CASE, "case.toml": CASE, "one.csv": ONE, "two.csv": TWO},
        "drive": {"study.toml": DRIVE},
        "mission": {"mission.toml": _file("examples/missions/house_search.toml")},
        "tuning": {"tuning.json": TUNING},
        "effect": {"effects.py": _file("examples/my_effects.py")},
    }  # fmt: skip
    return {what: {name: text.encode() for name, text in files.items()} for what, files in texts.items()}
