/* A client of libmodbus that reads ten registers over and over, for bench/small.py.
 *
 *     libmodbus_reads PORT COUNT        libmodbus_reads DEVICE COUNT
 *
 * Prints as JSON the seconds of processor time up to the first answer and for each further request, and the peak memory. */
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double used(void)
{
    struct timespec at;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &at);
    return (double)at.tv_sec + (double)at.tv_nsec / 1e9;
}

static long peak(void)
{
    char line[256];
    long kilobytes = 0;
    FILE *status = fopen("/proc/self/status", "r");
    while (status != NULL && fgets(line, sizeof line, status) != NULL)
        if (sscanf(line, "VmHWM: %ld", &kilobytes) == 1)
            break;
    return kilobytes * 1024;
}

int main(int argc, char **argv)
{
    uint16_t row[10];
    if (argc != 3)
        return 2;
    modbus_t *context = argv[1][0] == '/' ? modbus_new_rtu(argv[1], 115200, 'N', 8, 1)
                                          : modbus_new_tcp("127.0.0.1", atoi(argv[1]));
    if (context == NULL || modbus_set_slave(context, 1) != 0 || modbus_connect(context) != 0)
        return 1;
    if (modbus_read_registers(context, 0, 10, row) != 10)
        return 1;
    double first = used();
    int count = atoi(argv[2]);
    for (int done = 0; done < count; done++)
        if (modbus_read_registers(context, 0, 10, row) != 10)
            return 1;
    printf("{\"start\": %.9f, \"request\": %.9f, \"memory\": %ld}\n", first, (used() - first) / count, peak());
    modbus_close(context);
    modbus_free(context);
    return 0;
}
