/* A Raspberry Pi Pico, or another board with an RP2040 and a crystal of 12 MHz.
 * SPDX-License-Identifier: MIT */
#ifndef PORT_CONFIG_H
#define PORT_CONFIG_H

#define PORT_NAME "rp2040"
#ifndef PORT_CHANNELS
#define PORT_CHANNELS 1 /* 1 or 2; each has an output and an input */
#endif
#define PORT_MEMORY_ROWS (32000 / PORT_CHANNELS) /* table and record; the core counts up to 65536 bytes */
#define PORT_CLOCK_HZ 5000000UL
#ifndef PORT_SHORTEST
#define PORT_SHORTEST (PORT_CHANNELS == 1 ? 100 : 150)
#endif
#define PORT_LONGEST 65535
#define PORT_NAME_SIZE 8
#define PORT_NOINIT __attribute__((section(".noinit")))

#endif
