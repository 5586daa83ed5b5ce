#!/bin/sh
# Cases of public measurements by the two commands alone, each parameterised from its fit runs.
# Usage: make.sh DATA_FOLDER OUT_FOLDER [NAME ...]; README.md says what DATA_FOLDER holds.
set -eu
data=$1 out=$2
shift 2
a123=$data/a123_26650_plett panasonic=$data/panasonic_18650pf leaf=$data/nissan_leaf_2013_cell
all="a123_lfp a123_cold a123_warm panasonic_drive panasonic_cycle1 panasonic_cold panasonic_four panasonic_pulses k2_lfp
lg_mj1 dmegc_18650 nasa_ageing leaf_3c samsung_30q gear_motor propellers eddy_brake undc emps"

case_of() {  # IMPORT_OPTION...
    jaxmodel import "$@" --out "$out/imported/$name"
    jaxmodel parameterise "$out/imported/$name" --out "$out/$name"
}

motor() {
    case_of "$@" --kind motor --ambient 20
}

for name in ${*:-$all}; do
    case $name in
    a123_lfp)
        case_of "$a123"/dyn_p*.csv "$a123"/dyn_n05*.csv "$a123"/ocv_*_p25*.csv --kind cell --check dyn_n05degC ;;
    a123_cold)
        case_of "$a123"/dyn_n*.csv "$a123"/dyn_p05*.csv "$a123"/ocv_*_p05*.csv --kind cell --check dyn_n05degC ;;
    a123_warm)
        case_of "$a123"/dyn_p*.csv "$a123"/ocv_*_p*.csv --kind cell --check "*_p25degC" ;;
    panasonic_drive)
        case_of "$panasonic"/drive_us06_*degC.csv --kind cell --check "*_n20degC" ;;
    panasonic_cycle1)
        case_of "$panasonic"/drive_cycle1_*.csv "$panasonic"/drive_nn_p10degC.csv --kind cell --initial-soc 1 \
            --check drive_cycle1_n20degC --check drive_nn_p10degC ;;
    panasonic_cold)
        case_of "$panasonic"/drive_nn_p25*.csv "$panasonic"/drive_nn_n20*.csv "$panasonic"/drive_us06_p00*.csv \
            "$panasonic"/drive_us06_n20*.csv "$panasonic"/drive_cycle3*.csv --kind cell --initial-soc 1 \
            --check drive_us06_n20degC --check drive_cycle3_p25degC ;;
    panasonic_four | panasonic_pulses)
        pulses=$(test "$name" = panasonic_four || echo "$panasonic"/hppc_*.csv)
        case_of $pulses "$panasonic"/c20*.csv "$panasonic"/drive_cycle1_p25*.csv "$panasonic"/drive_cycle1_p00*.csv \
            "$panasonic"/drive_nn_p10*.csv "$panasonic"/drive_nn_n20*.csv "$panasonic"/drive_us06_*degC.csv \
            "$panasonic"/drive_cycle3*.csv --kind cell --check "drive_us06*" --check "drive_cycle3*" ;;
    k2_lfp)
        case_of "$data"/k2_lfp_26650/*.csv --kind cell --check "*_p50degC" ;;
    lg_mj1)
        case_of "$data"/lg_mj1_18650/*_10pct*.csv --kind cell --capacity 3.5 --check "*_p40degC" ;;
    dmegc_18650)
        case_of "$data"/dmegc_18650_electrothermal/cell1_[cop]*.csv --kind cell --ambient 25 --check "*_cc2C" ;;
    nasa_ageing)
        case_of "$data"/nasa_18650_ageing/discharges_B0006.csv --kind cell --ambient 24 \
            --check "*-09" --check "*-10" ;;
    leaf_3c)
        case_of "$leaf"/cell_hppc_p25degC.csv "$leaf"/cell_cc*.csv --kind cell --ambient 25 --check "*cc3C*" \
            --column "cell_temperature_degC=(temperature_tab_degC+temperature_middle_degC+temperature_bottom_degC)/3" ;;
    samsung_30q)
        case_of "$data"/samsung_30q_18650/cell1_c*.csv --kind cell --check "*_cc4C" ;;
    gear_motor)
        motor "$data"/gearmotor_prony_brake/static_load_points.csv --seconds-per-row 10 --split-at steps \
            --column voltage_V=applied_voltage_V --column step=applied_voltage_V \
            --rows "applied_voltage_V != 8 and not (torque_Nm < 0.02 and current_A > 0.2)" \
            --check static_load_points-4 --check static_load_points-5 ;;
    propellers)  # a quarter of the current less that of the electronics, and the duty's share of the voltage
        motor "$data"/crazyflie21_brushed/thrust_stand_cf21_stock_prop.csv --seconds-per-row 1 --rows "pwm > 0.15" \
            --column "voltage_V=pwm * deck_voltage_V" --column "current_A=(current_A - 0.19) / 4" \
            --column "speed_rad_s=(motor1_speed_rpm + motor2_speed_rpm + motor3_speed_rpm + motor4_speed_rpm) * 0.02618" \
            --column "step=(pwm > 0.5) * 1 + (pwm > 0.8) * 1" --split-at steps --constant load_torque_Nm=0 \
            --check "*-3" --check "*-4" --check "*-5" ;;
    eddy_brake)
        motor "$data"/hslu_dcmotor_eddy_brake/*_off*.csv --constant load_torque_Nm=0 --check "closed_loop*" ;;
    undc)
        motor "$data"/undcmotor/prbs_open_loop.csv "$data"/undcmotor/step_*.csv --constant load_torque_Nm=0 \
            --check "step*" ;;
    # A carriage; 1 m stands for 1 rad. Its 35.15 N/V are not in the data: state k_tau = 35.15 in case.toml, else forces and
    # mass are in the ratio of the paper's k_tau to it.
    emps)
        motor "$data"/emps/emps_estimation.csv --column current_A=drive_voltage_V --unit drive_voltage_V=A \
            --column position_rad=position_m --unit position_m=rad --constant load_torque_Nm=0 ;;
    *)
        echo "no case is called $name; there are $all" >&2
        exit 2 ;;
    esac
done
