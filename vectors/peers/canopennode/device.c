/* A node of CANopenNode with the objects of a case, in virtual time. What an application has to bring along is in here
   and nothing else: its objects, where it stores them, which bits of 1001h an error sets, and that a written value is an
   event of its TPDO. */

#define OD_DEFINITION
#include "canopennode.h"
#include "storage/CO_storage.h"

#include <string.h>

enum { OBJECTS = 400, MEMORY = 300000, TICK = 100, AREAS = 4 };

typedef struct {
    OD_size_t length, room;
    bool_t sized; /* DOMAIN: as long as what was written */
    uint8_t *data;
} value_t;

static OD_entry_t entries[OBJECTS + 1];
static uint16_t indices[OBJECTS];
static OD_obj_record_t subs[OBJECTS];
static OD_obj_var_t vars[OBJECTS];
static OD_extension_t extensions[OBJECTS];
static value_t values[OBJECTS], defaults[OBJECTS], stored[OBJECTS];
static uint8_t now_data[MEMORY], default_data[MEMORY], stored_data[MEMORY];
static OD_t od = {0, entries};
static unsigned sub_count, memory_used;
CO_t *co;
CO_config_t config;
static CO_storage_t storage;
static CO_storage_entry_t areas[AREAS];
static uint8_t pending_id, stored_id;
static uint16_t pending_rate, nmt_control;
static bool_t has_storage, is_master, lss_stores;
static uint8_t error_class[256];

/* The application: its objects ------------------------------------------------------------------------------------- */

static value_t *value_of(uint16_t index, uint8_t sub) {
    for (unsigned at = 0; at < sub_count; at++)
        if (indices[at] == index && subs[at].subIndex == sub)
            return &values[at];
    return NULL;
}

static ODR_t read_value(OD_stream_t *stream, void *buffer, OD_size_t count, OD_size_t *done) {
    value_t *value = value_of(stream->index, stream->subIndex);
    if (value->sized)
        stream->dataLength = value->length; /* a domain has nothing that says how long it is but the application */
    return OD_readOriginal(stream, buffer, count, done);
}

static ODR_t write_value(OD_stream_t *stream, const void *buffer, OD_size_t count, OD_size_t *done) {
    static uint8_t before[MEMORY];
    value_t *value = value_of(stream->index, stream->subIndex);
    ODR_t result;
    memcpy(before, value->data, value->length);
    if (value->sized) {
        if (stream->dataOffset + count > value->room)
            return ODR_OUT_OF_MEM;
        memcpy(value->data + stream->dataOffset, buffer, count);
        *done = count;
        stream->dataOffset += count;
        value->length = stream->dataOffset;
        /* 0: the size is not known yet; otherwise the transfer is whole when all of it is here */
        return stream->dataLength == 0U || stream->dataLength > stream->dataOffset ? ODR_PARTIAL : ODR_OK;
    }
    result = OD_writeOriginal(stream, buffer, count, done);
    if (result == ODR_OK && memcmp(before, value->data, value->length) != 0)
        OD_requestTPDO(OD_find(&od, stream->index), stream->subIndex);
    return result;
}

void clear(void) {
    if (co != NULL)
        CO_delete(co);
    co = NULL;
    od.size = 0;
    sub_count = memory_used = 0;
    memset(entries, 0, sizeof entries);
    memset(extensions, 0, sizeof extensions);
    memset(error_class, 0, sizeof error_class);
    (void)take();
    has_storage = is_master = false;
    stop_masters();
}

/* Add an object; `single`: it has no sub-indices. `sized`: a domain, with `room` for what is written. */
int object(unsigned index, unsigned sub, int single, unsigned attribute, const uint8_t *data, unsigned length,
           unsigned room) {
    if (sub_count == OBJECTS || memory_used + (room ? room : length) + 8U > MEMORY)
        return -1;
    value_t *value = &values[sub_count], *first = &defaults[sub_count];
    value->data = now_data + memory_used, first->data = default_data + memory_used;
    stored[sub_count].data = stored_data + memory_used;
    value->length = first->length = length;
    value->sized = first->sized = room != 0U;
    value->room = room;
    memset(default_data + memory_used, 0, (room ? room : length) + 1U);
    memcpy(first->data, data, length);
    memory_used += (room ? room : length) + 1U;
    OD_entry_t *entry = &entries[od.size ? od.size - 1U : 0U];
    if (od.size == 0U || entry->index != index) {
        entry = &entries[od.size++];
        entry->index = (uint16_t)index;
        entry->odObjectType = single ? ODT_VAR : ODT_REC;
        entry->odObject = single ? (void *)&vars[sub_count] : (void *)&subs[sub_count];
    }
    entry->subEntriesCount++;
    vars[sub_count] = (OD_obj_var_t){value->data, (OD_attr_t)attribute, value->sized ? 0U : length};
    subs[sub_count] = (OD_obj_record_t){value->data, (uint8_t)sub, (OD_attr_t)attribute, value->sized ? 0U : length};
    indices[sub_count++] = (uint16_t)index;
    return 0;
}

/* Read an object, as the application does: its length. */
int get(unsigned index, unsigned sub, uint8_t *data) {
    value_t *value = value_of((uint16_t)index, (uint8_t)sub);
    memcpy(data, value->data, value->length);
    return (int)value->length;
}

/* Store, restore: 1 all, 2 communication, 3 application, 4 manufacturer */
static unsigned area_of(unsigned index) { return index < 0x2000U ? 2U : index < 0x6000U ? 4U : 3U; }

static void copy(value_t *to, const value_t *from, unsigned area) {
    for (unsigned at = 0; at < sub_count; at++)
        if (area_of(indices[at]) == area) {
            memcpy(to[at].data, from[at].data, from[at].length);
            to[at].length = from[at].length;
        }
}

static ODR_t store(CO_storage_entry_t *entry, CO_CANmodule_t *module) {
    (void)module;
    copy(stored, values, entry->subIndexOD);
    return ODR_OK;
}

static ODR_t restore(CO_storage_entry_t *entry, CO_CANmodule_t *module) {
    (void)module;
    copy(stored, defaults, entry->subIndexOD);
    return ODR_OK;
}

static bool_t store_lss(void *object_of, uint8_t id, uint16_t rate) {
    (void)object_of, (void)rate;
    stored_id = id;
    return true;
}

static bool_t any_rate(void *object_of, uint16_t rate) {
    (void)object_of, (void)rate;
    return true;
}

unsigned error_bits(const uint8_t *status, unsigned count) {
    unsigned bits = 0;
    for (unsigned bit = 0; bit < count * 8U; bit++)
        if ((status[bit / 8U] >> (bit % 8U) & 1U) != 0U)
            bits |= error_class[bit] ? error_class[bit] : bit < 32U ? 0x11U : 0x01U;
    return bits;
}

/* Set an object, as the application does. */
int set(unsigned index, unsigned sub, const uint8_t *data, unsigned length) {
    value_t *value = value_of((uint16_t)index, (uint8_t)sub);
    if (value == NULL || (!value->sized && length > value->length))
        return -1;
    bool_t changed = length != value->length || memcmp(value->data, data, length) != 0;
    memcpy(value->data, data, length);
    if (value->sized)
        value->length = length;
    if (changed)
        OD_requestTPDO(OD_find(&od, (uint16_t)index), (uint8_t)sub);
    return 0;
}

void error(int is_set, unsigned bit, unsigned code, unsigned info, unsigned bits) {
    if (is_set)
        error_class[bit & 0xFFU] = (uint8_t)bits;
    CO_error(co->em, is_set != 0, (uint8_t)bit, (uint16_t)code, info);
}

/* The node --------------------------------------------------------------------------------------------------------- */

static unsigned count_of(unsigned first, unsigned limit) {
    unsigned count = 0;
    while (count < limit && OD_find(&od, (uint16_t)(first + count)) != NULL)
        count++;
    return count;
}

static unsigned highest(unsigned index) {
    OD_entry_t *entry = OD_find(&od, (uint16_t)index);
    return entry == NULL ? 0U : entry->subEntriesCount - 1U;
}

static int begin(void) {
    uint32_t wrong = 0, address[4] = {0, 0, 0, 0};
    CO_ReturnError_t result;
    co->CANmodule->CANnormal = false;
    if ((result = CO_CANinit(co, &od, pending_rate)) != CO_ERROR_NO)
        return result;
    for (uint8_t sub = 1; sub <= 4U; sub++)
        (void)OD_get_u32(OD_find(&od, 0x1018), sub, &address[sub - 1U], true);
    CO_LSS_address_t lss;
    memcpy(lss.addr, address, sizeof address);
    if (config.CNT_LSS_SLV == 1U) {
        if ((result = CO_LSSinit(co, &lss, &pending_id, &pending_rate)) != CO_ERROR_NO)
            return result;
        CO_LSSslave_initCkBitRateCall(co->LSSslave, NULL, any_rate);
        if (lss_stores)
            CO_LSSslave_initCfgStoreCall(co->LSSslave, NULL, store_lss);
    }
    for (unsigned at = 0; at < od.size; at++)
        if (entries[at].index >= 0x2000U) {
            extensions[at] = (OD_extension_t){.read = read_value, .write = write_value};
            (void)OD_extension_init(&entries[at], &extensions[at]);
        }
    result = CO_CANopenInit(co, NULL, NULL, &od, NULL, nmt_control, 0xFFFF, 1000, 1000, false, pending_id, &wrong);
    if (result == CO_ERROR_NO)
        result = CO_CANopenInitPDO(co, co->em, &od, pending_id, &wrong);
    if (result != CO_ERROR_NO && result != CO_ERROR_NODE_ID_UNCONFIGURED_LSS) {
        say("error %d %X\n", result, (unsigned)wrong);
        return result;
    }
    if (has_storage) {
        result = CO_storage_init(&storage, co->CANmodule, OD_find(&od, 0x1010), OD_find(&od, 0x1011), store, restore,
                                 areas, AREAS - 1);
        storage.enabled = true;
    }
    if (is_master)
        listen_to_gateway();
    CO_CANsetNormalMode(co->CANmodule);
    return CO_ERROR_NO;
}

static void power_on(void) {
    for (unsigned area = 2; area <= 4U; area++)
        copy(values, stored, area);
    pending_id = stored_id;
}

/* Switch the node on; 255: it has no node-ID. lss: 0 no slave, 1 a slave, 2 a slave without storage. */
int start(unsigned node, int lss, int master, unsigned control) {
    memset(&config, 0, sizeof config);
    config.CNT_NMT = config.CNT_EM = config.CNT_SDO_SRV = 1;
    config.ENTRY_H1017 = OD_find(&od, 0x1017);
    config.ENTRY_H1016 = OD_find(&od, 0x1016);
    config.CNT_ARR_1016 = (uint8_t)highest(0x1016);
    config.CNT_HB_CONS = config.CNT_ARR_1016 != 0U;
    config.ENTRY_H100C = OD_find(&od, 0x100C);
    config.ENTRY_H100D = OD_find(&od, 0x100D);
    config.ENTRY_H1001 = OD_find(&od, 0x1001);
    config.ENTRY_H1014 = OD_find(&od, 0x1014);
    config.ENTRY_H1015 = OD_find(&od, 0x1015);
    config.ENTRY_H1003 = OD_find(&od, 0x1003);
    config.CNT_ARR_1003 = (uint8_t)highest(0x1003);
    config.ENTRY_H1200 = OD_find(&od, 0x1200);
    if (config.ENTRY_H1200 != NULL)
        config.CNT_SDO_SRV = (uint8_t)count_of(0x1200, 0x80);
    config.ENTRY_H1012 = OD_find(&od, 0x1012);
    config.CNT_TIME = config.ENTRY_H1012 != NULL;
    config.ENTRY_H1005 = OD_find(&od, 0x1005);
    config.ENTRY_H1006 = OD_find(&od, 0x1006);
    config.ENTRY_H1007 = OD_find(&od, 0x1007);
    config.ENTRY_H1019 = OD_find(&od, 0x1019);
    config.CNT_SYNC = config.ENTRY_H1005 != NULL;
    config.ENTRY_H1400 = OD_find(&od, 0x1400), config.ENTRY_H1600 = OD_find(&od, 0x1600);
    config.ENTRY_H1800 = OD_find(&od, 0x1800), config.ENTRY_H1A00 = OD_find(&od, 0x1A00);
    config.CNT_RPDO = (uint16_t)count_of(0x1400, 0x200);
    config.CNT_TPDO = (uint16_t)count_of(0x1800, 0x200);
    config.CNT_LSS_SLV = lss != 0;
    lss_stores = lss == 1;
    config.ENTRY_H1280 = OD_find(&od, 0x1280);
    config.CNT_SDO_CLI = config.CNT_LSS_MST = config.CNT_GTWA = is_master = master != 0;
    has_storage = OD_find(&od, 0x1010) != NULL && OD_find(&od, 0x1011) != NULL;
    for (unsigned area = 2; area <= 4U; area++) {
        copy(stored, defaults, area);
        areas[area - 2U] = (CO_storage_entry_t){.subIndexOD = (uint8_t)area, .attr = CO_storage_cmd | CO_storage_restore};
    }
    stored_id = (uint8_t)node;
    pending_rate = 125;
    nmt_control = (uint16_t)control;
    co = CO_new(&config, NULL);
    if (co == NULL)
        return -100;
    power_on();
    return begin();
}

/* Let CANopenNode work for a time, which may be 0. */
static void process(uint32_t passed) {
    CO_NMT_reset_cmd_t reset = CO_process(co, is_master, passed, NULL);
    if (co->CANmodule->CANnormal && !co->nodeIdUnconfigured) {
        bool_t sync = CO_process_SYNC(co, passed, NULL);
        CO_process_RPDO(co, sync, passed, NULL);
        CO_process_TPDO(co, sync, passed, NULL);
    }
    masters(passed);
    if (reset == CO_RESET_APP || reset == CO_RESET_QUIT) {
        power_on();
        (void)begin();
    } else if (reset == CO_RESET_COMM)
        (void)begin();
}

void run(unsigned microseconds) {
    for (; microseconds >= TICK; microseconds -= TICK)
        process(TICK);
    for (unsigned again = 0; again < 4U; again++)
        process(0);
}

void feed(unsigned ident, int remote, unsigned length, const uint8_t *data) {
    frame_t frame = {(uint16_t)(ident | (remote ? 0x800U : 0U)), (uint8_t)length, {0}};
    memcpy(frame.data, data, length);
    for (unsigned at = 0; at < co->CANmodule->rxSize; at++) {
        CO_CANrx_t *rx = &co->CANmodule->rxArray[at];
        if (rx->CANrx_callback != NULL && ((frame.ident ^ rx->ident) & rx->mask) == 0U) {
            rx->CANrx_callback(rx->object, &frame);
            break;
        }
    }
    run(0);
}

/* The identifier of a service, as CANopenNode gave it to the driver: a letter, and the number of a PDO. */
int identifier(int service, unsigned number) {
    const CO_CANrx_t *rx = co->CANmodule->rxArray;
    const CO_CANtx_t *tx = co->CANmodule->txArray;
    switch (service) {
        case 'N': return rx[co->RX_IDX_NMT_SLV].ident;
        case 'S': return CO_CAN_ID_SYNC;
        case 'E': return (int)tx[co->TX_IDX_EM_PROD].ident;
        case 'T': return CO_CAN_ID_TIME;
        case 't': return (int)tx[co->TX_IDX_TPDO + number - 1U].ident;
        case 'r': return rx[co->RX_IDX_RPDO + number - 1U].ident;
        case 'q': return rx[co->RX_IDX_SDO_SRV].ident;
        case 'a': return (int)tx[co->TX_IDX_SDO_SRV].ident;
        case 'h': return (int)tx[co->TX_IDX_HB_PROD].ident;
        case 'L': return rx[co->RX_IDX_LSS_SLV].ident;
        case 'l': return (int)tx[co->TX_IDX_LSS_SLV].ident;
        default: return -1;
    }
}

int restricted(unsigned ident) { return CO_IS_RESTRICTED_CAN_ID(ident); }
