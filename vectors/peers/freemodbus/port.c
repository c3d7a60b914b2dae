/* The port of FreeModbus for main.py: a byte, an event and a timer, each a variable. */

#include "port.h"

#include "mb.h"
#include "mbport.h"

unsigned char port_byte;  /* what the line has received */
int port_event = -1;      /* the last event */
int port_timer;           /* whether the timer runs */
unsigned port_timer_50us; /* its time */

BOOL xMBPortSerialInit(UCHAR port, ULONG baud, UCHAR bits, eMBParity parity, UCHAR stop_bits) {
    (void)port, (void)baud, (void)bits, (void)parity, (void)stop_bits;
    return TRUE;
}
void vMBPortSerialEnable(BOOL receives, BOOL sends) { (void)receives, (void)sends; }
void vMBPortClose(void) {}
BOOL xMBPortSerialGetByte(CHAR *byte) {
    *byte = (CHAR)port_byte;
    return TRUE;
}
BOOL xMBPortSerialPutByte(CHAR byte) {
    (void)byte;
    return TRUE;
}
BOOL xMBPortEventInit(void) { return TRUE; }
BOOL xMBPortEventPost(eMBEventType event) {
    port_event = (int)event;
    return TRUE;
}
BOOL xMBPortEventGet(eMBEventType *event) {
    *event = (eMBEventType)port_event;
    return port_event >= 0;
}
BOOL xMBPortTimersInit(USHORT time_50us) {
    port_timer_50us = time_50us;
    return TRUE;
}
void vMBPortTimersEnable(void) { port_timer = 1; }
void vMBPortTimersDisable(void) { port_timer = 0; }
void vMBPortTimersDelay(USHORT milliseconds) { (void)milliseconds; }
void vMBPortEnterCritical(void) {}
void vMBPortExitCritical(void) {}
