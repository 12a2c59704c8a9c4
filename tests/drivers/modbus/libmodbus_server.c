/* A Modbus server made of libmodbus, an independent implementation. Built by the tests.
 *
 * tcp          serves any free port of this machine and prints it
 * rtu PATH     serves unit 1 at a serial port, 115200 8N1, and prints "ready"
 *
 * Input register i repeats holding register i, as a converter's input follows its output.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define N 64

static int serve(modbus_t *link, modbus_mapping_t *map)
{
    uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
    for (;;) {
        int size = modbus_receive(link, request);
        if (size > 0) {
            modbus_reply(link, request, size, map);
            memcpy(map->tab_input_registers, map->tab_registers, N * sizeof(uint16_t));
        } else if (size < 0) {
            if (errno == ECONNRESET || errno == EIO) return 0;
        }
    }
}

int main(int count, char **words)
{
    modbus_mapping_t *map = modbus_mapping_new(16, 16, N, N);
    if (count == 2 && strcmp(words[1], "tcp") == 0) {
        struct sockaddr_in address;
        socklen_t size = sizeof address;
        modbus_t *link = modbus_new_tcp("127.0.0.1", 0);
        int listener = modbus_tcp_listen(link, 1);
        if (listener < 0 || getsockname(listener, (struct sockaddr *)&address, &size)) return 1;
        printf("%d\n", ntohs(address.sin_port));
        fflush(stdout);
        while (modbus_tcp_accept(link, &listener) >= 0) {
            serve(link, map);
            modbus_close(link);
        }
    } else if (count == 3 && strcmp(words[1], "rtu") == 0) {
        modbus_t *link = modbus_new_rtu(words[2], 115200, 'N', 8, 1);
        modbus_set_slave(link, 1);
        if (modbus_connect(link)) return 1;
        printf("ready\n");
        fflush(stdout);
        serve(link, map);
    }
    return 2;
}
