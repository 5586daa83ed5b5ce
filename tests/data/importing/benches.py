"""Logs of a made cell and of a made motor, and the text formats in which cyclers export them."""

from __future__ import annotations

import numpy as np
import pandas as pd

CAPACITY_AH = 3.0


def cell_log(seed: int = 0, resistance_ohm: float = 0.03, step_s: float = 10.0) -> pd.DataFrame:
    """A full cell: rests, pulses, emptied at 1C, rest, charged to 4.2 V; current positive on discharge."""
    parts = [(600, 0.0), (60, 6.0), (600, 0.0), (60, 6.0), (600, 0.0), (3500, 2.9), (1200, 0.0), (3600, -2.0)]
    current = np.concatenate([np.full(int(seconds / step_s), amperes) for seconds, amperes in parts])
    time_s = np.arange(current.size) * step_s
    soc = 1.0 - np.cumsum(current) * step_s / 3600.0 / CAPACITY_AH
    voltage = 3.0 + 1.2 * soc - resistance_ohm * current
    noise = np.random.default_rng(seed).normal(0.0, 2e-4, current.size)
    warm = 25.0 + np.convolve(current**2, np.exp(-np.arange(60) / 20.0), "full")[: current.size] * 0.01
    return pd.DataFrame(
        {
            "time_s": time_s,
            "current_A": current,
            "voltage_V": np.round(voltage + noise, 4),
            "temperature_degC": np.round(warm, 2),
            "step": np.concatenate([np.full(int(s / step_s), n) for n, (s, _) in enumerate(parts, start=1)]),
        }
    )


def motor_log(seconds: float = 4.0, step_s: float = 0.01) -> pd.DataFrame:
    """A motor of 0.5 ohm and 0.05 V s/rad at four voltages under two loads."""
    time_s = np.arange(0.0, seconds, step_s)
    voltage = 6.0 * (1.0 + np.floor(4.0 * time_s / seconds))
    torque = 0.05 + 0.05 * (time_s > seconds / 2)
    current = (torque + 0.01) / 0.05
    speed = (voltage - 0.5 * current) / 0.05
    columns = {"time_s": time_s, "voltage_V": voltage, "current_A": current}
    return pd.DataFrame({**columns, "torque_Nm": torque, "speed_rad_s": speed})


def stamps(log: pd.DataFrame, form: str) -> pd.Series:
    return (pd.Timestamp("2024-03-01 08:00:00") + pd.to_timedelta(log.time_s, unit="s")).dt.strftime(form)


def arbin(log: pd.DataFrame) -> str:
    """Arbin's CSV: units in brackets, current positive on charge."""
    table = pd.DataFrame(
        {
            "Data_Point": np.arange(1, len(log) + 1),
            "Test_Time(s)": log.time_s,
            "Date_Time": stamps(log, "%Y-%m-%d %H:%M:%S"),
            "Step_Time(s)": log.time_s - log.groupby("step").time_s.transform("min"),
            "Step_Index": log.step,
            "Cycle_Index": 1,
            "Current(A)": -log.current_A,
            "Voltage(V)": log.voltage_V,
            "Charge_Capacity(Ah)": 0.0,
            "Discharge_Capacity(Ah)": (np.maximum(log.current_A, 0.0) * 10.0 / 3600.0).cumsum(),
            "Internal_Resistance(Ohm)": 0.0,
            "dV/dt(V/s)": 0.0,
            "Aux_Temperature_1(C)": log.temperature_degC,
        }
    )
    return table.to_csv(index=False)


def maccor(log: pd.DataFrame) -> str:
    """Maccor's text: two lines of title, tabs, an unsigned current and a state."""
    state = np.where(log.current_A > 0, "D", np.where(log.current_A < 0, "C", "R"))
    table = pd.DataFrame(
        {
            "Rec#": [f"{n:,}" for n in range(1, len(log) + 1)],
            "Cyc#": 0,
            "Step": log.step,
            "Test (Sec)": log.time_s,
            "Step (Sec)": log.time_s - log.groupby("step").time_s.transform("min"),
            "Amp-hr": 0.0,
            "Watt-hr": 0.0,
            "Amps": log.current_A.abs(),
            "Volts": log.voltage_V,
            "State": state,
            "ES": 1,
            "DPt Time": stamps(log, "%m/%d/%Y %I:%M:%S %p"),
            "Temp 1": log.temperature_degC,
        }
    )
    head = "Today's Date 03/02/2024  Date of Test:\t03/01/2024\tFilename: cell.001\tProcedure: hppc\n"
    return head + "\n" + table.to_csv(index=False, sep="\t")


def biologic(log: pd.DataFrame) -> bytes:
    """BioLogic's text (.mpt): its own count of header lines, tabs, decimal commas, mA positive on charge."""
    table = pd.DataFrame(
        {
            "mode": 1,
            "ox/red": 1,
            "error": 0,
            "control changes": 0,
            "Ns changes": 0,
            "counter inc.": 0,
            "Ns": log.step,
            "time/s": log.time_s,
            "control/V/mA": 0.0,
            "Ewe/V": log.voltage_V,
            "<I>/mA": -1000.0 * log.current_A,
            "dQ/mA.h": 0.0,
            "(Q-Qo)/mA.h": 0.0,
            "Temperature/°C": log.temperature_degC,
        }
    )
    settings = [f"setting {n} : {n}" for n in range(1500)]
    lines = ["EC-Lab ASCII FILE", f"Nb header lines : {len(settings) + 4}", "", *settings]
    rows = table.to_csv(index=False, sep="\t", decimal=",", float_format="%.7E", lineterminator="\r\n")
    return ("\r\n".join([*lines, ""]) + rows).encode("cp1252")


def neware(log: pd.DataFrame) -> str:
    """Neware's flat CSV: mA, the time of the step and the total time as h:min:s."""

    def clock(seconds: pd.Series) -> list[str]:
        return [f"{int(s // 3600):02d}:{int(s % 3600 // 60):02d}:{s % 60:06.3f}" for s in seconds]

    kinds = np.where(log.current_A > 0, "CC DChg", np.where(log.current_A < 0, "CC Chg", "Rest"))
    table = pd.DataFrame(
        {
            "DataPoint": np.arange(1, len(log) + 1),
            "Cycle Index": 1,
            "Step Index": log.step,
            "Step Type": kinds,
            "Time": clock(log.time_s - log.groupby("step").time_s.transform("min")),
            "Total Time": clock(log.time_s),
            "Current(mA)": -1000.0 * log.current_A,
            "Voltage(V)": log.voltage_V,
            "Capacity(mAh)": 0.0,
            "Date": stamps(log, "%Y-%m-%d %H:%M:%S"),
            "T1(℃)": log.temperature_degC,
        }
    )
    return table.to_csv(index=False)


def neware_layered(log: pd.DataFrame) -> str:
    """Neware's report: tables of cycles, steps and records in one file, each indented by one field."""
    lines = ["Cycle ID,Cap_Chg(mAh),Cap_DChg(mAh),,,", ",Step ID,Step Name,Step Time(h:min:s.ms),,"]
    lines.append(",,Record ID,Time(h:min:s.ms),Voltage(V),Current(mA),Temperature(C)")
    lines.append("1,2900.0,3000.0,,,,")
    record = 0
    for step, rows in log.groupby("step"):
        name = "CC_DChg" if rows.current_A.iloc[0] > 0 else "CC_Chg" if rows.current_A.iloc[0] < 0 else "Rest"
        lines.append(f",{step},{name},00:10:00.000,,,")
        for row in rows.itertuples():
            record += 1
            seconds = row.time_s - rows.time_s.iloc[0]
            clock = f"{int(seconds // 3600):02d}:{int(seconds % 3600 // 60):02d}:{seconds % 60:06.3f}"
            lines.append(f",,{record},{clock},{row.voltage_V},{-1000.0 * row.current_A},{row.temperature_degC}")
    return "\n".join(lines) + "\n"


def battery_data_format(log: pd.DataFrame) -> str:
    """The Battery Data Format: its fixed labels, current positive on charge."""
    table = pd.DataFrame(
        {
            "Test Time / s": log.time_s,
            "Voltage / V": log.voltage_V,
            "Current / A": -log.current_A,
            "Unix Time / s": 1_709_280_000.0 + log.time_s,
            "Cycle Count / 1": 1,
            "Step Count / 1": log.step,
            "Ambient Temperature / degC": 25.0,
            "Temperature T1 / degC": log.temperature_degC,
        }
    )
    return table.to_csv(index=False)


FORMATS = {
    "arbin.csv": arbin,
    "maccor.txt": maccor,
    "biologic.mpt": biologic,
    "neware.csv": neware,
    "neware_layered.csv": neware_layered,
    "bdf.csv": battery_data_format,
}
