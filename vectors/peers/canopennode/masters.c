/* Masters: consumers of heartbeats, the gateway, an SDO client, LSS. Each goes on while time passes. */

#include "canopennode.h"

#include <string.h>

static void hb_started(uint8_t node, uint8_t at, void *object_of) {
    (void)at, (void)object_of;
    say("event %u started\n", node);
}

static void hb_state(uint8_t node, uint8_t at, CO_NMT_internalState_t state, void *object_of) {
    (void)at, (void)object_of;
    say("event %u state %d\n", node, state);
}

static void hb_lost(uint8_t node, uint8_t at, void *object_of) {
    (void)at, (void)object_of;
    say("event %u lost\n", node);
}

static void hb_booted(uint8_t node, uint8_t at, void *object_of) {
    (void)at, (void)object_of;
    say("event %u booted\n", node);
}

/* Report what the consumer of 1016h finds. */
void watch(void) {
    for (uint8_t at = 0; at < config.CNT_ARR_1016; at++) {
        CO_HBconsumer_initCallbackHeartbeatStarted(co->HBcons, at, NULL, hb_started);
        CO_HBconsumer_initCallbackNmtChanged(co->HBcons, at, NULL, hb_state);
        CO_HBconsumer_initCallbackTimeout(co->HBcons, at, NULL, hb_lost);
        CO_HBconsumer_initCallbackRemoteReset(co->HBcons, at, NULL, hb_booted);
    }
}

/* What the consumer made of the first entry of 1016h: 0, it is unused. */
int consumer(unsigned *node, unsigned *milliseconds) {
    const CO_HBconsNode_t *first = &co->HBconsMonitoredNodes[0];
    *node = first->nodeId;
    *milliseconds = first->time_us / 1000U;
    return first->HBstate != CO_HBconsumer_UNCONFIGURED;
}

static size_t gateway_text(void *object_of, const char *text, size_t count, uint8_t *connected) {
    (void)object_of;
    *connected = 1;
    for (size_t at = 0; at < count; at++)
        if (text[at] != '\r')
            say("%s%c", begins_line() ? "text " : "", text[at]);
    return count;
}

void listen_to_gateway(void) { CO_GTWA_initRead(co->gtwa, gateway_text, NULL); }

int gateway(const char *line) {
    size_t length = strlen(line);
    return CO_GTWA_write(co->gtwa, line, length) == length ? 0 : -1;
}

static char transfer; /* U upload, D download, 0 none */
static uint8_t client_data[CO_CONFIG_SDO_CLI_BUFFER_SIZE];

int transfer_start(int direction, unsigned node, unsigned index, unsigned sub, int block, const uint8_t *data,
                   unsigned length, int indicated) {
    CO_SDOclient_t *client = co->SDOclient;
    CO_SDO_return_t result = CO_SDOclient_setup(client, 0x600U + node, 0x580U + node, (uint8_t)node);
    if (result == CO_SDO_RT_ok_communicationEnd)
        result = direction == 'U'
                     ? CO_SDOclientUploadInitiate(client, (uint16_t)index, (uint8_t)sub, 1000, block != 0)
                     : CO_SDOclientDownloadInitiate(client, (uint16_t)index, (uint8_t)sub, indicated ? length : 0U,
                                                    1000, block != 0);
    if (direction == 'D' && CO_SDOclientDownloadBufWrite(client, data, length) < length)
        return -100;
    transfer = result == CO_SDO_RT_ok_communicationEnd ? (char)direction : 0;
    return result;
}

static void transfer_step(uint32_t passed) {
    CO_SDO_abortCode_t code = CO_SDO_AB_NONE;
    CO_SDO_return_t result =
        transfer == 'U' ? CO_SDOclientUpload(co->SDOclient, passed, false, &code, NULL, NULL, NULL)
                        : CO_SDOclientDownload(co->SDOclient, passed, false, false, &code, NULL, NULL);
    if (result > 0)
        return;
    say("sdo %d %08X ", result, (unsigned)code);
    size_t length = transfer == 'U' ? CO_SDOclientUploadBufRead(co->SDOclient, client_data, sizeof client_data) : 0U;
    for (size_t at = 0; at < length; at++)
        say("%02X", client_data[at]);
    say("\n");
    CO_SDOclientClose(co->SDOclient);
    transfer = 0;
}

static char lss_service; /* a letter of lss_start, 0 none */
static uint32_t lss_values[8];
static CO_LSS_address_t address;
static CO_LSSmaster_fastscan_t scan;

/* G global, W all wait, A activate, S selective, I address, N node, C configure node, B bit rate, T store, F fastscan:
   values 0 to 3 are the address, 4 to 7 what CO_LSSmaster_scantype_t says */
void lss_start(int service, const uint32_t *values_of) {
    memcpy(lss_values, values_of, sizeof lss_values);
    memset(&scan, 0, sizeof scan);
    for (unsigned at = 0; at < 4U; at++) {
        scan.match.addr[at] = lss_values[at];
        scan.scan[at] = (CO_LSSmaster_scantype_t)lss_values[4U + at];
    }
    memcpy(address.addr, lss_values, sizeof address.addr);
    lss_service = (char)service;
}

static void lss_step(uint32_t passed) {
    CO_LSSmaster_t *master = co->LSSmaster;
    uint32_t value = 0;
    CO_LSSmaster_return_t result = CO_LSSmaster_INVALID_STATE;
    switch (lss_service) {
        case 'G': result = CO_LSSmaster_swStateSelect(master, passed, NULL); break;
        case 'W': result = CO_LSSmaster_swStateDeselect(master); break;
        case 'A': result = CO_LSSmaster_ActivateBit(master, (uint16_t)lss_values[0]); break;
        case 'S': result = CO_LSSmaster_swStateSelect(master, passed, &address); break;
        case 'I': result = CO_LSSmaster_InquireLssAddress(master, passed, &address); break;
        case 'N': result = CO_LSSmaster_Inquire(master, passed, CO_LSS_INQUIRE_NODE_ID, &value); break;
        case 'C': result = CO_LSSmaster_configureNodeId(master, passed, (uint8_t)lss_values[0]); break;
        case 'B': result = CO_LSSmaster_configureBitTiming(master, passed, (uint16_t)lss_values[0]); break;
        case 'T': result = CO_LSSmaster_configureStore(master, passed); break;
        case 'F': result = CO_LSSmaster_IdentifyFastscan(master, passed, &scan); break;
        default: break;
    }
    if (result == CO_LSSmaster_WAIT_SLAVE)
        return;
    const uint32_t *found = lss_service == 'F' ? scan.found.addr : address.addr;
    say("lss %d %u %08X %08X %08X %08X\n", result, (unsigned)value, (unsigned)found[0], (unsigned)found[1],
        (unsigned)found[2], (unsigned)found[3]);
    lss_service = 0;
}

void masters(uint32_t passed) {
    if (transfer != 0)
        transfer_step(passed);
    if (lss_service != 0)
        lss_step(passed);
}

void stop_masters(void) { transfer = lss_service = 0; }
