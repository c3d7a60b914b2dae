/* The bus and the lines of text: what CANopenNode sends is kept as "585#4B...", for take. */

#include "canopennode.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static char said[1 << 20];
static size_t said_length;

void say(const char *form, ...) {
    va_list arguments;
    va_start(arguments, form);
    said_length += (size_t)vsnprintf(said + said_length, sizeof said - said_length, form, arguments);
    va_end(arguments);
}

int begins_line(void) { return said_length == 0 || said[said_length - 1] == '\n'; }

const char *take(void) {
    said[said_length] = 0;
    said_length = 0;
    return said;
}

void CO_CANsetConfigurationMode(void *pointer) { (void)pointer; }
void CO_CANsetNormalMode(CO_CANmodule_t *module) { module->CANnormal = true; }
void CO_CANmodule_disable(CO_CANmodule_t *module) { (void)module; }
void CO_CANmodule_process(CO_CANmodule_t *module) { (void)module; }
void CO_CANclearPendingSyncPDOs(CO_CANmodule_t *module) { (void)module; }

CO_ReturnError_t CO_CANmodule_init(CO_CANmodule_t *module, void *pointer, CO_CANrx_t rx[], uint16_t rx_size,
                                   CO_CANtx_t tx[], uint16_t tx_size, uint16_t rate) {
    (void)rate;
    memset(module, 0, sizeof *module);
    memset(rx, 0, rx_size * sizeof *rx);
    memset(tx, 0, tx_size * sizeof *tx);
    module->CANptr = pointer;
    module->rxArray = rx, module->rxSize = rx_size;
    module->txArray = tx, module->txSize = tx_size;
    return CO_ERROR_NO;
}

CO_ReturnError_t CO_CANrxBufferInit(CO_CANmodule_t *module, uint16_t at, uint16_t ident, uint16_t mask, bool_t remote,
                                    void *object, void (*callback)(void *object, void *message)) {
    if (module == NULL || object == NULL || callback == NULL || at >= module->rxSize)
        return CO_ERROR_ILLEGAL_ARGUMENT;
    CO_CANrx_t *rx = &module->rxArray[at];
    rx->ident = (ident & 0x7FFU) | (remote ? 0x800U : 0U);
    rx->mask = (mask & 0x7FFU) | 0x800U;
    rx->object = object;
    rx->CANrx_callback = callback;
    return CO_ERROR_NO;
}

CO_CANtx_t *CO_CANtxBufferInit(CO_CANmodule_t *module, uint16_t at, uint16_t ident, bool_t remote, uint8_t length,
                               bool_t sync) {
    if (module == NULL || at >= module->txSize)
        return NULL;
    CO_CANtx_t *tx = &module->txArray[at];
    tx->ident = (ident & 0x7FFU) | (remote ? 0x800U : 0U);
    tx->DLC = length;
    tx->bufferFull = false;
    tx->syncFlag = sync;
    return tx;
}

CO_ReturnError_t CO_CANsend(CO_CANmodule_t *module, CO_CANtx_t *buffer) {
    (void)module;
    say("%03X#", (unsigned)(buffer->ident & 0x7FFU));
    if ((buffer->ident & 0x800U) != 0U)
        say("R%u", buffer->DLC);
    for (unsigned at = 0; (buffer->ident & 0x800U) == 0U && at < buffer->DLC; at++)
        say("%02X", buffer->data[at]);
    say("\n");
    return CO_ERROR_NO;
}
