/* An ATmega1284P with a crystal of 16 MHz.
 * SPDX-License-Identifier: MIT */
#ifndef PORT_CONFIG_H
#define PORT_CONFIG_H

#define PORT_NAME "atmega1284p"
#ifndef PORT_CHANNELS
#define PORT_CHANNELS 1 /* 1 or 2; each has an output and an input */
#endif
#define PORT_MEMORY_ROWS (7424 / PORT_CHANNELS) /* table and record; 1.5 of 16 KB remain for everything else */
#define PORT_CLOCK_HZ 16000000UL
#ifndef PORT_SHORTEST
#define PORT_SHORTEST (PORT_CHANNELS == 1 ? 800 : 1200)
#endif
#define PORT_LONGEST 65535
#define PORT_NAME_SIZE 8
#define PORT_NOINIT __attribute__((section(".noinit")))

#endif
