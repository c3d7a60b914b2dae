/* The state machine of GMP as CiA 402 has it: its header turns on a shortcut for tests, from switch on disabled with 000Fh. */

#include <ctl/framework/cia402_state_machine.h>
#undef CIA402_CONFIG_ENABLE_SEQUENCE_SWITCH
#include <ctl/framework/src/ctl_cia402_state_machine.c>
