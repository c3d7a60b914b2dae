/* A libmodbus server with a hundred entries in each table.
 *
 *     libmodbus_server tcp PORT       libmodbus_server tcp_pi PORT       libmodbus_server rtu DEVICE
 *
 * Prints "ready" and its version, and serves one client after the other until it is killed. Input register 4 holds 1234,
 * discrete input 6 is on; a read from holding register 50 on is answered with "busy" (exception 06) by modbus_reply_exception. */
#include <errno.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    if (argc != 3)
        return 2;
    int tcp = !strncmp(argv[1], "tcp", 3), pi = !strcmp(argv[1], "tcp_pi"), listener = -1;
    modbus_t *ctx = pi    ? modbus_new_tcp_pi("127.0.0.1", argv[2])
                    : tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2]))
                          : modbus_new_rtu(argv[2], 115200, 'N', 8, 1);
    modbus_mapping_t *table = modbus_mapping_new(100, 100, 100, 100);
    if (ctx == NULL || table == NULL || modbus_set_slave(ctx, 1) != 0)
        return 1;
    table->tab_input_registers[4] = 1234;
    table->tab_input_bits[6] = 1;
    listener = pi ? modbus_tcp_pi_listen(ctx, 4) : tcp ? modbus_tcp_listen(ctx, 4) : -1;
    if (tcp ? listener == -1 : modbus_connect(ctx) == -1) {
        fprintf(stderr, "%s\n", modbus_strerror(errno));
        return 1;
    }
    puts("ready " LIBMODBUS_VERSION_STRING);
    fflush(stdout);
    for (;;) {
        if (tcp && (pi ? modbus_tcp_pi_accept(ctx, &listener) : modbus_tcp_accept(ctx, &listener)) == -1)
            return 1;
        for (;;) {
            uint8_t request[MODBUS_MAX_ADU_LENGTH];
            int length = modbus_receive(ctx, request), at = modbus_get_header_length(ctx);
            if (length == -1 && tcp)
                break; /* the client closed the connection: wait for the next */
            if (length <= 0)
                continue; /* damaged, or for another unit */
            if (request[at] == 0x03 && request[at + 2] == 50)
                modbus_reply_exception(ctx, request, MODBUS_EXCEPTION_SLAVE_OR_SERVER_BUSY);
            else
                modbus_reply(ctx, request, length, table);
        }
        close(modbus_get_socket(ctx));
    }
}
