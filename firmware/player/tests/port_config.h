/* The host, with little of everything, so that tests reach each limit.
 * SPDX-License-Identifier: MIT */
#ifndef PORT_CONFIG_H
#define PORT_CONFIG_H

#define PORT_NAME "host"
#define PORT_CHANNELS 2
#define PORT_MEMORY_ROWS 300
#define PORT_CLOCK_HZ 1000000UL
#define PORT_SHORTEST 10
#define PORT_LONGEST 1000
#define PORT_NAME_SIZE 8
#define PLAYER_SAFE 100
#define PLAYER_LOWEST 50
#define PLAYER_HIGHEST 60000

#endif
