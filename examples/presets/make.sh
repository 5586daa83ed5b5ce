#!/bin/sh
# Presets from measured data, by the two commands alone: three of the package, and three that it does not hold.
# Usage: make.sh DATA_FOLDER OUT_FOLDER [NAME ...]; README.md says what DATA_FOLDER holds.
set -eu
data=$1 out=$2
shift 2
arts="ARTS-Lab, University of South Carolina, GitHub ARTS-Laboratory"
here=$(cd "$(dirname "$0")" && pwd)
panasonic=$data/panasonic_18650pf servo=$data/hobby_servo_lift

preset() {  # NAME TITLE DATA LICENCE IMPORT_OPTION...
    name=$1 title=$2 from=$3 licence=$4
    shift 4
    jaxmodel import "$@" --title "$title" --answer-only --out "$out/$name/case"
    jaxmodel parameterise "$out/$name/case" --preset "$name" --data "$from" --licence "$licence" --out "$out/$name"
}

for name in ${*:-k2_lfp_26650 lg_mj1 coreless_7x16}; do
    case $name in
    k2_lfp_26650)
        preset "$name" "K2 Energy 26650 LFP, 2.2 A h" \
            "$arts/dataset-K2-26650-cell-characterization, commit 682baaae" "CC BY-SA 4.0" \
            "$data"/k2_lfp_26650/*.csv --kind cell --check cc1C_p30degC ;;
    lg_mj1)
        preset "$name" "LG INR18650-MJ1 that gave 2.9 A h" \
            "$arts/dataset-LG-MJ1-INR-18650-cell-characterization, commit 60490059" "CC BY-SA 4.0" \
            "$data"/lg_mj1_18650/*.csv --kind cell ;;
    coreless_7x16)
        # At full duty the motors have the voltage of the battery; at others the switch takes a share that is not known.
        preset "$name" "7x16 mm coreless motor of a Crazyflie 2.1" \
            "Bitcraze and IMRCLab, GitHub IMRCLab/crazyflie-system-id, commit 76a64de, data/bitcraze2021" "MIT" \
            "$data"/crazyflie21_brushed/thrust_stand_cf21_stock_prop.csv --kind motor --load propeller --ambient 22 \
            --rows "pwm > 0.965" --split-at steps --column step=pwm --seconds-per-row 0.25 \
            --column "voltage_V=battery_voltage_V*pwm" --column "current_A=(current_A-0.19)/4" \
            --column "speed_rad_s=(motor1_speed_rpm+motor2_speed_rpm+motor3_speed_rpm+motor4_speed_rpm)/4*0.10472" \
            --preset "$here"/known_coreless_7x16.toml ;;
    panasonic_18650pf)
        preset "$name" "Panasonic NCR18650PF, 2.9 A h" \
            "P. Kollmeyer, Panasonic 18650PF Li-ion Battery Data, Mendeley Data v1, DOI 10.17632/wykht8y7tg.1; \
copy GitHub fededc88/Panasonic-18650PF-Data, commit 6d720489" \
            "not verified (the copy states none; cite the DOI)" \
            "$panasonic"/runs.csv "$panasonic"/c20_*.csv "$panasonic"/hppc_*.csv "$panasonic"/drive_nn_*.csv \
            "$panasonic"/drive_us06_*degC.csv "$panasonic"/drive_cycle1_p25degC.csv \
            "$panasonic"/cc1C_p25degC_start1.csv \
            --kind cell --check "drive_us06*" --check "drive_cycle1*" --check "cc1C*" ;;
    prony_gearmotor)
        preset "$name" "an unnamed 12 V gear motor measured on a brake" \
            "GitHub gkret123/DC-Motor-Data-Analysis, commit 972c5218, GK_Data_M1.xlsx" "none stated" \
            "$data"/gearmotor_prony_brake/static_load_points.csv --kind motor --ambient 20 --seconds-per-row 10 \
            --split-at steps --column voltage_V=applied_voltage_V --column step=applied_voltage_V \
            --rows "applied_voltage_V != 8 and not (torque_Nm < 0.02 and current_A > 0.2)" \
            --check static_load_points-4 --check static_load_points-5 ;;
    hobby_servo_s3315d)
        preset "$name" "HJ S3315D hobby servo with its gear, 7 V" \
            "S. Pfrommer, GitHub spfrommer/servo-experiment, commit 8d48684b, folder processed" "none stated" \
            "$servo"/runs.csv "$servo"/load_*.csv --kind motor --ambient 20 --constant voltage_V=7.15 \
            --rows "direction == 'lift' and angle_deg > 40 and angle_deg < 140" --column step=run --split-at steps \
            --check "load_100g*" --check "load_300g*" --check "load_600g*" ;;
    *)
        echo "no preset is called $name" >&2
        exit 2 ;;
    esac
done
