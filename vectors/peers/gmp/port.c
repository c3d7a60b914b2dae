/* The platform and the power stage of GMP for main.py: time stands still, and every step of the power stage is done. */

#include "gmp_core.h"

#define STEP(name) \
    int name(void) { return 1; }

STEP(ctl_check_compliance)
STEP(ctl_check_encoder)
STEP(ctl_check_pll_locked)
STEP(ctl_disable_grid_relay)
STEP(ctl_disable_main_contactor)
STEP(ctl_disable_precharge_relay)
STEP(ctl_disable_pwm)
STEP(ctl_enable_grid_relay)
STEP(ctl_enable_main_contactor)
STEP(ctl_enable_precharge_relay)
STEP(ctl_enable_pwm)
STEP(ctl_exec_adc_calibration)
STEP(ctl_exec_dc_voltage_ready)
STEP(ctl_exec_rotor_alignment)
STEP(ctl_fault_recover_routine)
STEP(ctl_release_brake)
STEP(ctl_restore_brake)

time_gt gmp_base_get_ctrl_tick(void) { return 0; }
time_gt gmp_base_time_sub(time_gt now, time_gt then) { return now - then; }
void gmp_base_assert(void) {}
