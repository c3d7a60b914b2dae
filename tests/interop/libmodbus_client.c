/* Every call of a libmodbus client, against a server with the table that test_libmodbus.py prepares.
 *
 *     libmodbus_client tcp HOST PORT       libmodbus_client tcp_pi HOST PORT       libmodbus_client rtu DEVICE
 *
 * socat connects it to servers over TLS and on serial lines over TCP. Prints each successful call; exits with status 1 at the
 * first failure. */
#include <errno.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(const char *name, int ok)
{
    if (!ok) {
        fprintf(stderr, "%s: %s\n", name, modbus_strerror(errno));
        exit(1);
    }
    puts(name);
}

static int refused(int result, int error)
{
    return result == -1 && errno == error;
}

int main(int argc, char **argv)
{
    modbus_t *ctx = NULL;
    if (argc == 4 && !strcmp(argv[1], "tcp"))
        ctx = modbus_new_tcp(argv[2], atoi(argv[3]));
    else if (argc == 4 && !strcmp(argv[1], "tcp_pi"))
        ctx = modbus_new_tcp_pi(argv[2], argv[3]);
    else if (argc == 3)
        ctx = modbus_new_rtu(argv[2], 115200, 'N', 8, 1);
    check("new", ctx != NULL);
    check("set_slave", modbus_set_slave(ctx, 1) == 0 && modbus_get_slave(ctx) == 1);
    uint32_t s = 0, us = 0;
    check("set_response_timeout", modbus_set_response_timeout(ctx, 2, 0) == 0);
    check("get_response_timeout", modbus_get_response_timeout(ctx, &s, &us) == 0 && s == 2 && us == 0);
    check("set_byte_timeout", modbus_set_byte_timeout(ctx, 1, 1) == 0);
    check("get_byte_timeout", modbus_get_byte_timeout(ctx, &s, &us) == 0 && s == 1 && us == 1);
    check("set_indication_timeout", modbus_set_indication_timeout(ctx, 3, 0) == 0);
    check("get_indication_timeout", modbus_get_indication_timeout(ctx, &s, &us) == 0 && s == 3);
    check("set_debug", modbus_set_debug(ctx, 0) == 0);
    check("set_error_recovery", modbus_set_error_recovery(ctx, MODBUS_ERROR_RECOVERY_NONE) == 0);
    check("connect", modbus_connect(ctx) == 0);
    check("get_socket", modbus_get_socket(ctx) >= 0 && modbus_set_socket(ctx, modbus_get_socket(ctx)) == 0);
    check("flush", modbus_flush(ctx) >= 0);

    uint8_t bits[MODBUS_MAX_READ_BITS], many_bits[MODBUS_MAX_WRITE_BITS], pattern[] = {1, 0, 1, 1, 0, 0, 1, 0, 1, 1};
    uint16_t registers[MODBUS_MAX_READ_REGISTERS], many[MODBUS_MAX_WRITE_REGISTERS], values[] = {0x1234, 0xFFFF, 0, 7};

    check("write_bit", modbus_write_bit(ctx, 20, 1) == 1);
    check("write_bits", modbus_write_bits(ctx, 0, 10, pattern) == 10);
    check("read_bits", modbus_read_bits(ctx, 0, 10, bits) == 10 && !memcmp(bits, pattern, 10));
    check("read_bits again", modbus_read_bits(ctx, 20, 1, bits) == 1 && bits[0] == 1);
    check("read_bits, most", modbus_read_bits(ctx, 0, MODBUS_MAX_READ_BITS, bits) == MODBUS_MAX_READ_BITS);
    check("read_input_bits", modbus_read_input_bits(ctx, 6, 2, bits) == 2 && bits[0] == 1 && bits[1] == 0);

    check("write_register", modbus_write_register(ctx, 9, 0xBEEF) == 1);
    check("write_registers", modbus_write_registers(ctx, 0, 4, values) == 4);
    check("read_registers", modbus_read_registers(ctx, 0, 4, registers) == 4 && !memcmp(registers, values, 8));
    check("read_registers again", modbus_read_registers(ctx, 9, 1, registers) == 1 && registers[0] == 0xBEEF);
    check("read_registers, most", modbus_read_registers(ctx, 0, MODBUS_MAX_READ_REGISTERS, registers) == 125);
    check("read_input_registers", modbus_read_input_registers(ctx, 4, 1, registers) == 1 && registers[0] == 1234);
    check("mask_write_register", modbus_mask_write_register(ctx, 0, 0x00F2, 0x0025) == 1);
    check("masked", modbus_read_registers(ctx, 0, 1, registers) == 1
                        && registers[0] == ((0x1234 & 0x00F2) | (0x0025 & ~0x00F2)));
    check("write_and_read_registers",
          modbus_write_and_read_registers(ctx, 30, 2, values, 29, 4, registers) == 4 && registers[1] == 0x1234
              && registers[2] == 0xFFFF && registers[3] == 0);

    /* As many as fit into a request, and one more, which libmodbus refuses itself. */
    for (int i = 0; i < MODBUS_MAX_WRITE_BITS; i++)
        many_bits[i] = i % 3 == 0;
    for (int i = 0; i < MODBUS_MAX_WRITE_REGISTERS; i++)
        many[i] = 1000 + i;
    check("write_bits, most", modbus_write_bits(ctx, 2000, MODBUS_MAX_WRITE_BITS, many_bits) == 1968);
    check("written", modbus_read_bits(ctx, 2000, 1968, bits) == 1968 && !memcmp(bits, many_bits, 1968));
    check("write_registers, most", modbus_write_registers(ctx, 2000, MODBUS_MAX_WRITE_REGISTERS, many) == 123);
    check("written, too", modbus_read_registers(ctx, 2000, 123, registers) == 123 && !memcmp(registers, many, 246));
    check("write_and_read_registers, most",
          modbus_write_and_read_registers(ctx, 3000, MODBUS_MAX_WR_WRITE_REGISTERS, many, 2998, 125, registers) == 125
              && registers[1] == 0 && registers[2] == 1000 && registers[122] == 1120);
    check("one too many", refused(modbus_read_registers(ctx, 0, MODBUS_MAX_READ_REGISTERS + 1, registers), EMBMDATA));

    /* -1500000 as ABCD. Not with modbus_set_float_abcd: in libmodbus 3.1.6 it does not match modbus_get_float_abcd. */
    uint16_t words[] = {0xC9B7, 0x1B00};
    check("write float", modbus_write_registers(ctx, 40, 2, words) == 2);
    check("read float", modbus_read_registers(ctx, 40, 2, registers) == 2 && modbus_get_float_abcd(registers) == -1.5e6f);
    check("get_float_cdab", modbus_get_float_cdab((uint16_t[]){words[1], words[0]}) == -1.5e6f);
    check("get_float_badc", modbus_get_float_badc((uint16_t[]){0xB7C9, 0x001B}) == -1.5e6f);
    check("get_float_dcba", modbus_get_float_dcba((uint16_t[]){0x001B, 0xB7C9}) == -1.5e6f);

    uint8_t id[MODBUS_MAX_PDU_LENGTH];
    int length = modbus_report_slave_id(ctx, sizeof id, id);
    check("report_slave_id", length > 2 && memmem(id, length, "table", 5) != NULL); /* the product */

    /* Raw requests only for functions whose answer length libmodbus knows: not 2B. */
    uint8_t answer[MODBUS_MAX_ADU_LENGTH];
    uint8_t status[] = {1, 0x07};
    check("send_raw_request", modbus_send_raw_request(ctx, status, sizeof status) > 0);
    length = modbus_receive_confirmation(ctx, answer);
    check("receive_confirmation", length == (argc == 4 ? 9 : 5) && answer[modbus_get_header_length(ctx) + 1] == 0x5A);

    check("illegal address", refused(modbus_read_registers(ctx, 9999, 2, registers), EMBXILADD));
    check("illegal address, written", refused(modbus_write_bit(ctx, 10000, 1), EMBXILADD));
    uint8_t much[] = {1, 0x03, 0, 0, 0, 126};
    check("send 126", modbus_send_raw_request(ctx, much, sizeof much) > 0);
    check("receive_confirmation 126", modbus_receive_confirmation(ctx, answer) > 0);
    check("illegal value", answer[modbus_get_header_length(ctx)] == 0x83 && answer[modbus_get_header_length(ctx) + 1] == 3);
    check("still there", modbus_read_registers(ctx, 9, 1, registers) == 1 && registers[0] == 0xBEEF);

    if (argc == 3) { /* on a serial line: no answer to a broadcast, or for another unit */
        modbus_set_response_timeout(ctx, 0, 200000);
        modbus_set_slave(ctx, MODBUS_BROADCAST_ADDRESS);
        check("broadcast", refused(modbus_write_register(ctx, 8, 77), ETIMEDOUT));
        modbus_set_slave(ctx, 9);
        check("another unit", refused(modbus_read_registers(ctx, 8, 1, registers), ETIMEDOUT));
        modbus_set_slave(ctx, 1);
        modbus_set_response_timeout(ctx, 2, 0);
        check("carried out", modbus_read_registers(ctx, 8, 1, registers) == 1 && registers[0] == 77);
    }
    modbus_close(ctx);
    check("connect again", modbus_connect(ctx) == 0 && modbus_read_registers(ctx, 9, 1, registers) == 1);
    modbus_close(ctx);
    modbus_free(ctx);
    puts("all");
    return 0;
}
