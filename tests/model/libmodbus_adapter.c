/* The client of libmodbus on the line of the checker. The library is the installed one: the system calls of its RTU backend
 * are found here first, because peers.py loads this file with RTLD_DEEPBIND.
 *
 *     modbus_read_registers  ->  libmodbus.so  ->  write, select, read  ->  this file  ->  functions of the checker */
#include <errno.h>
#include <modbus/modbus.h>
#include <stdint.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { VIRTUAL = 1000 }; /* a file descriptor that is not open, below FD_SETSIZE */

static void (*transmit)(const uint8_t *data, int count);
static int (*wait_for_bytes)(double seconds);
static int (*receive)(uint8_t *data, int count);
static modbus_t *client;

ssize_t write(int fd, const void *data, size_t count)
{
    if (fd != VIRTUAL)
        return syscall(SYS_write, fd, data, count);
    transmit(data, (int)count);
    return (ssize_t)count;
}

ssize_t read(int fd, void *data, size_t count)
{
    return fd == VIRTUAL ? receive(data, (int)count) : syscall(SYS_read, fd, data, count);
}

int select(int count, fd_set *readable, fd_set *writable, fd_set *broken, struct timeval *timeout)
{
    (void)count, (void)readable, (void)writable, (void)broken; /* libmodbus waits for its port only */
    return wait_for_bytes(timeout->tv_sec + timeout->tv_usec * 1e-6);
}

int adapter_open(void (*on_transmit)(const uint8_t *, int), int (*on_wait)(double), int (*on_receive)(uint8_t *, int),
                 int microseconds)
{
    transmit = on_transmit, wait_for_bytes = on_wait, receive = on_receive;
    if (client)
        modbus_free(client);
    client = modbus_new_rtu("virtual", 19200, 'N', 8, 1);
    return client && !modbus_set_slave(client, 1) && !modbus_set_socket(client, VIRTUAL) &&
           !modbus_set_response_timeout(client, microseconds / 1000000, microseconds % 1000000);
}

/* Register 7, or -1. */
int adapter_ask(void)
{
    uint16_t value;
    return modbus_read_registers(client, 7, 1, &value) == 1 ? value : -1;
}

int adapter_version(void)
{
    return libmodbus_version_major << 16 | libmodbus_version_minor << 8 | libmodbus_version_micro;
}
