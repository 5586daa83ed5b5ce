"""The quantities of a bench's log by the names that benches give them: data, the surest name first."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Quantity:
    """What a column may hold.

    Attributes:
        unit: a unit that it can be converted to, as `jaxmodel.base.units` writes it; None if it has none.
        names: whole names in lower case, without unit; the first is the surest.
        words: a name that contains one of these may be it too.
        also: such a name must contain one of these as well.
        without: a name that contains one of these is something else.
        with_unit: of the whole names, those that count only where a unit is stated ("Test (Sec)").
        counts: it is a number of steps or a word: a column with a unit is something else.
    """

    unit: str | None
    names: tuple[str, ...]
    words: frozenset[str] = frozenset()
    also: frozenset[str] = frozenset()
    without: frozenset[str] = frozenset()
    with_unit: frozenset[str] = frozenset()
    counts: bool = False


def _of(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _names(text: str) -> tuple[str, ...]:
    return tuple(" ".join(name.split()) for name in text.split(","))


# Words of what is wanted rather than measured.
NOT_MEASURED = _of("command commanded set drive input applied nominal supply control")
MEASURED = _of("measured actual sensed gemessen")  # speaks against the words above
WANTED = _of("setpoint reference ref goal target limit max min maximum minimum desired soll error range cutoff")
# Words of what no column of a case holds: such a column is never taken for one by its unit or its readings.
ELSEWHERE = _of(
    "force thrust lift drag axis axes cmd power energy work capacity charge resistance impedance ocv frequency freq "
    "pressure altitude height humidity weight mass strain stress flow distance latitude longitude lat lon gps heading "
    "roll yaw gyro accelerometer magnetometer vibration noise efficiency cost rssi gain offset index count counter "
    "number flag fault id rate crate kraft leistung energie kapazität druck gewicht 功率 能量 容量 力"
)
_COUNTED = _of("capacity energy charge power density resistance slope dv di dt dq std sigma integral")
_AMBIENT = _of("ambient amb chamber room environment environmental air oven umgebung surroundings lab klima outside")
_WINDING = _of("winding coil copper wicklung phase")
_HOUSING = _of("case housing stator body gehäuse frame shell")
HEAT = _of("temperature temp temperatur température temperatura thermocouple tc rtd 温度")
# A controller counts the turns of the field: as many times those of the shaft as the motor has pole pairs.
ELECTRICAL = _of("e erpm electrical")
_GEARED = _of("motor winding coil stator")
# Whose voltage is a signal.
_SENSORS = _of("encoder sensor hall shunt potentiometer pot tacho tach photodiode thermistor ntc signal adc ain")
_PACK = frozenset(["battery", "bat", "batt", "pack", "bat volt"])  # by its unit, 'Battery (V)' is a voltage
_ELECTRONICS = _of("mos mosfet mosfets fet fets esc controller inverter driver board pcb cpu mcu imu baro chip tube")

QUANTITIES: dict[str, Quantity] = {
    "time": Quantity(
        "s",
        _names(
            "time, test time, total time, elapsed time, t, time elapsed, run time, running time, prog "
            "time, program time,"
            "prog time sum, total test time, test, elapsed, relative test time, zeit, prüfzeit, temps, x value, x axis,"
            "time since start, duration, time s, test time second, 总时间, 测试时间, seconds, secs, sec,"
            "cumulative time, accumulated time, tempo, tiempo, temps écoulé, tempo totale, tempo total, t now, tnow,"
            "now, millis, micros, milliseconds, t rel, t elapsed, t total, t run, t abs, t sec, t test"
        ),
        _of("time zeit tempo tiempo"),
        without=_of(
            "step stamp date day clock unix utc real system absolute dpt charge discharge rest relative start end go "
            "left remaining"
        )
        | WANTED,
        with_unit=_of("test"),
    ),
    "step_time": Quantity(
        "s",
        _names("step time, steptime, relative time, step elapsed time, schrittzeit, step, 相对时间, step time second"),
        without=_of("total"),
        with_unit=_of("step"),
    ),
    "stamp": Quantity(
        None,
        _names(
            "date time, datetime, timestamp, time stamp, dpt time, unix time, unix time second, absolute "
            "time, real time,"
            "realtime, system time, abs time, date, utc, utc time, epoch, epoch time, recorded time, datum, datumzeit,"
            "date and time, 绝对时间, 系统时间, clock"
        ),
        _of("datetime timestamp stamp unix utc absolute"),
    ),
    "current": Quantity(
        "A",
        _names(
            "current, i, amps, cell current, battery current, measured current, current measured, amp, "
            "amperes, cur, strom,"
            "stromstärke, courant, corriente, corrente, intensidad, intensité, i cell, i batt, i bat, i battery,"
            "current ampere, im, 电流, 电流值, curr, i inst, iinst, i avg, iavg,"
            "pack current, bat current, batt current, bat curr, ibat, ipack, i pack, battery, bat, batt, pack"
        ),
        _of("current amps strom 电流 curr corrente corriente courant"),
        without=WANTED | _COUNTED | _of("range index motor step left right phase"),
        with_unit=_PACK,
    ),
    "voltage": Quantity(
        "V",
        _names(
            "voltage, cell voltage, terminal voltage, battery voltage, ewe, ecell, ewe ece, volts, u, v, volt, vcell,"
            "measured voltage, voltage measured, spannung, zellspannung, tension, tensión, tensao, tensão, tensione,"
            "voltaje, potential, u cell, u batt, "
            "v batt, v cell,"
            "voltage volt, vf, 电压, 电压值, ewe v, v tot, vtot, pack voltage, total voltage, sum voltage, bat voltage,"
            "batt voltage, bat volt, vbat, vbatt, vpack, v pack, battery, bat, batt, pack"
        ),
        _of("voltage volts spannung 电压 ewe ecell tension tensión tensao tensão tensione voltaje"),
        without=WANTED | _COUNTED | _SENSORS | _of("group aux open ocv supply lsupply"),
        with_unit=_PACK,
    ),
    "state": Quantity(
        None,
        _names("state, md, status, step type, mode, step name, step state, 工步类型, 状态, es, step mode"),
        counts=True,
    ),
    "step": Quantity(
        None,
        _names(
            "step index, step, step number, step id, step no, step num, ns, step count, schritt, 工步号, 工步序号, "
            "step index 1, step count 1"
        ),
        counts=True,
    ),
    "cycle": Quantity(
        None,
        _names(
            "cycle, cycle index, cycle number, cycle id, cycle count, cyc, cyc#, run, test run, "
            "repetition, zyklus, 循环号,"
            "循环序号, cycle no"
        ),
        counts=True,
    ),
    "discharged_charge": Quantity(
        "A h",
        _names(
            "discharge capacity, discharging capacity, capacity dchg, cap dchg, dchg cap, discharged, q discharge,"
            "放电容量"
        ),
        _of("discharge discharged discharging"),
        also=_of("capacity charge ah cap"),
        without=_of("energy spec specific"),
    ),
    "charged_charge": Quantity(
        "A h",
        _names("charge capacity, charging capacity, capacity chg, cap chg, chg cap, charged, q charge, 充电容量"),
    ),
    "cell_temperature": Quantity(
        "degC",
        _names(
            "cell temperature, surface temperature, temperature, temp, battery temperature, battery temp, cell temp,"
            "skin temperature, temperature middle, temperatur, temperatura, température, zelltemperatur,"
            "temperature measured, temperature t1,"
            "aux temperature 1, aux temperature 1 1, temperature 1, temp 1, t1, tc1, t cell, t surf, t surface, evtemp,"
            "cell temp 1, temp1, ntc1, ntc 1, ntc, battery t1, temperature1, aux temperature, 温度, 辅温, celltemp,"
            "can, temperature t1 celsius, cell, surface, cell surface, aux 1, aux"
        ),
        HEAT | _of("t"),
        without=_AMBIENT | WANTED | _GEARED | _ELECTRONICS,
        with_unit=frozenset(["cell", "surface", "cell surface", "aux 1", "aux"]),
    ),
    "ambient_temperature": Quantity(
        "degC",
        _names(
            "ambient temperature, chamber temperature, ambient, chamber, ambient temp, chamber temp, t "
            "amb, t ambient, tamb,"
            "room temperature, environment temperature, air temperature, oven temperature, umgebungstemperatur,"
            "ambient temperature celsius, temp chamber, klimakammer, t chamber, t env, 环境温度"
        ),
        _AMBIENT,
        also=HEAT | _of("t"),
        without=WANTED | _of("above"),
    ),
    "winding_temperature": Quantity(
        "degC",
        _names("winding temperature, coil temperature, copper temperature, t winding, wicklungstemperatur, t w"),
        _WINDING,
        also=HEAT | _of("t"),
        without=_AMBIENT | _of("interface"),
    ),
    "case_temperature": Quantity(
        "degC",
        _names(
            "case temperature, housing temperature, motor temperature, stator body temperature, stator temperature,"
            "body temperature, t case, t housing, gehäusetemperatur, temperature, motor temp, temp"
        ),
        _HOUSING,
        also=HEAT | _of("t"),
        without=_AMBIENT,
    ),
    "motor_voltage": Quantity(
        "V",
        _names(
            "motor voltage, voltage, terminal voltage, armature voltage, u, v, volts, u motor, v motor, motorspannung,"
            "tension, tensión, tensao, tensão, tensione, voltaje"
        ),
        _of("voltage volts spannung tension tensión tensao tensão tensione voltaje"),
        without=WANTED | _SENSORS | _of("battery pack cell deck bus vbus"),
    ),
    "motor_current": Quantity(
        "A",
        _names(
            "motor current, current, armature current, i, amps, i motor, motorstrom, phase current, winding current,"
            "corrente, corriente, courant"
        ),
        _of("current amps strom corrente corriente courant"),
        without=WANTED | _COUNTED | _of("battery pack"),
    ),
    "speed": Quantity(
        "rad/s",
        _names(
            "speed, motor speed, shaft speed, angular velocity, angular speed, rotational speed, velocity, "
            "rpm, omega, n,"
            "drehzahl, rotor speed, speed measured, measured speed, encoder speed, w, vel, velocidad, velocidade,"
            "vitesse, velocità"
        ),
        _of("speed velocity vel rpm omega drehzahl velocidad velocidade vitesse velocità"),
        without=WANTED | ELECTRICAL | _of("wheel"),
    ),
    "angle": Quantity(
        "rad",
        _names("position, angle, motor position, motor angle, shaft angle, encoder, encoder position, theta, winkel"),
        _of("position angle encoder winkel"),
        without=WANTED | _of("speed velocity vel rpm"),
    ),
    "load_torque": Quantity(
        "N m",
        _names(
            "load torque, torque, brake torque, shaft torque, measured torque, drehmoment, moment, load, m, torque load"
        ),
        _of("torque drehmoment"),
        without=WANTED | _of("enable constant motor"),
    ),
    "duty": Quantity(
        "",
        _names("duty, duty cycle, pwm duty, pwm, motor duty, duty ratio, throttle, tastgrad"),
        _of("duty pwm"),
        without=_of("flipper arm"),
    ),
    "set_voltage": Quantity("V", _names("v set, vset, set voltage, setpoint voltage")),
    "pack_voltage": Quantity(
        "V",
        _names(
            "pack voltage, battery voltage, bus voltage, supply voltage, vbat, v batt, vbatt, u batt, voltage, v bus,"
            "total voltage, sum voltage, bat voltage, batt voltage, bat volt, vpack, v pack, battery, bat, batt,"
            "pack"
        ),
        _of("voltage"),
        also=_of("battery pack bus supply bms total input"),
        without=WANTED | _of("cell motor"),
        with_unit=_PACK,
    ),
    "pack_current": Quantity(
        "A",
        _names(
            "pack current, battery current, bus current, total current, ibat, i batt, current, i bus, bat current,"
            "batt current, bat curr, ipack, i pack, battery, bat, batt, pack"
        ),
        _of("current"),
        also=_of("battery pack bus total bms input"),
        without=WANTED | _of("motor balance"),
        with_unit=_PACK,
    ),
    "incline": Quantity("deg", _names("incline, slope, inclination, pitch, grade angle, steigung")),
    "acceleration": Quantity("m/s2", _names("acceleration, acc x, accel")),
    "soc": Quantity(
        "",
        _names(
            "soc, state of charge, ladezustand, battery level, battery soc, batt soc, pack soc, battery state of charge"
        ),
        _of("soc"),
        without=WANTED,
    ),
}
