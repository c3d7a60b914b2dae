/* CANopenNode behind functions for bus.py: a bus that records, and time that is an argument.

   object ...      the object dictionary, from a list, in the order of index and sub-index
   start           a node with it: CO_new and the steps of CANopenNode's example, as after power-on
   feed, run       a frame arrives; time passes
   take            what was said: frames and events, a text line each */

#ifndef CANOPENNODE_H
#define CANOPENNODE_H

#include "CANopen.h"

extern CO_t *co;
extern CO_config_t config;

void say(const char *form, ...);
int begins_line(void);
const char *take(void);

void masters(uint32_t passed);
void stop_masters(void);
void listen_to_gateway(void);

#endif
