/* The settings of CANopenNode for these files: all services are on, one thread, a bus that only records. */

#ifndef CO_DRIVER_TARGET_H
#define CO_DRIVER_TARGET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CO_MULTIPLE_OD

/* all services of CiA 301 and 305, on both sides; 4000h: parameters can be changed at run-time */
#define CO_CONFIG_NMT           0x03
#define CO_CONFIG_HB_CONS       (0x4000 | 0x05)
#define CO_CONFIG_NODE_GUARDING 0x03
#define CO_CONFIG_EM            (0x4000 | 0x0F)
#define CO_CONFIG_SDO_SRV       (0x4000 | 0x06)
#define CO_CONFIG_SDO_CLI       (0x4000 | 0x07)
#define CO_CONFIG_SDO_SRV_BUFFER_SIZE 2000
#define CO_CONFIG_SDO_CLI_BUFFER_SIZE 2000
#define CO_CONFIG_SDO_CLI_PST 0U /* the protocol is not switched */
#define CO_CONFIG_TIME          (0x4000 | 0x03)
#define CO_CONFIG_SYNC          (0x4000 | 0x03)
#define CO_CONFIG_PDO           (0x4000 | 0x3F)
#define CO_CONFIG_STORAGE       0x01
#define CO_CONFIG_LEDS          0
#define CO_CONFIG_LSS           0x11
#define CO_CONFIG_GTW           0xFE
#define CO_CONFIG_GTWA_COMM_BUF_SIZE 2000
#define CO_CONFIG_GTWA_LOG_BUF_SIZE 2000
#define CO_CONFIG_GTW_BLOCK_DL_LOOP 1
#define CO_CONFIG_CRC16         0x01
#define CO_CONFIG_FIFO          0x1F

/* the bits of 1001h are those of the class of the error: the application says which bit an error sets */
unsigned error_bits(const uint8_t *status, unsigned count);
#define ERROR_BIT(bit) ((error_bits(em->errorStatusBits, sizeof em->errorStatusBits) & (bit)) != 0U)
#define CO_CONFIG_ERR_CONDITION_GENERIC       ERROR_BIT(0x01U)
#define CO_CONFIG_ERR_CONDITION_CURRENT       ERROR_BIT(0x02U)
#define CO_CONFIG_ERR_CONDITION_VOLTAGE       ERROR_BIT(0x04U)
#define CO_CONFIG_ERR_CONDITION_TEMPERATURE   ERROR_BIT(0x08U)
#define CO_CONFIG_ERR_CONDITION_COMMUNICATION ERROR_BIT(0x10U)
#define CO_CONFIG_ERR_CONDITION_MANUFACTURER  ERROR_BIT(0x80U)

#define CO_LITTLE_ENDIAN
#define CO_SWAP_16(x) x
#define CO_SWAP_32(x) x
#define CO_SWAP_64(x) x
typedef uint_fast8_t bool_t;
typedef float float32_t;
typedef double float64_t;

/* a received frame; 800h in its identifier: a remote frame */
typedef struct {
    uint16_t ident;
    uint8_t length;
    uint8_t data[8];
} frame_t;

#define CO_CANrxMsg_readIdent(msg) (((frame_t *)(msg))->ident & 0x7FFU)
#define CO_CANrxMsg_readDLC(msg)   (((frame_t *)(msg))->length)
#define CO_CANrxMsg_readData(msg)  ((const uint8_t *)((frame_t *)(msg))->data)

typedef struct {
    uint16_t ident, mask;
    void *object;
    void (*CANrx_callback)(void *object, void *message);
} CO_CANrx_t;

typedef struct {
    uint32_t ident;
    uint8_t DLC, data[8];
    volatile bool_t bufferFull, syncFlag;
} CO_CANtx_t;

typedef struct {
    void *CANptr;
    CO_CANrx_t *rxArray;
    CO_CANtx_t *txArray;
    uint16_t rxSize, txSize, CANerrorStatus;
    volatile bool_t CANnormal;
} CO_CANmodule_t;

typedef struct {
    void *addr;
    size_t len;
    uint8_t subIndexOD, attr;
    void *addrNV;
} CO_storage_entry_t;

#define CO_LOCK_CAN_SEND(module)
#define CO_UNLOCK_CAN_SEND(module)
#define CO_LOCK_EMCY(module)
#define CO_UNLOCK_EMCY(module)
#define CO_LOCK_OD(module)
#define CO_UNLOCK_OD(module)
#define CO_MemoryBarrier()
#define CO_FLAG_READ(flag)  ((flag) != NULL)
#define CO_FLAG_SET(flag)   ((flag) = (void *)1L)
#define CO_FLAG_CLEAR(flag) ((flag) = NULL)

#endif
