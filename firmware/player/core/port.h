/* What a port provides: the converters, the clock, the lines and the serial line of one board.
 * SPDX-License-Identifier: MIT
 *
 * port_config.h of the port defines PORT_NAME, PORT_CHANNELS, PORT_MEMORY_ROWS, PORT_CLOCK_HZ,
 * PORT_SHORTEST and PORT_LONGEST (ticks of that clock between two points), PORT_NAME_SIZE. */
#ifndef PORT_H
#define PORT_H

#include <stdbool.h>
#include <stdint.h>

#include "port_config.h"

#ifndef PORT_NOINIT
#define PORT_NOINIT /* on a memory that need not be cleared at the start, which would delay the safe value */
#endif
#ifndef PLAYER_SAFE
#define PLAYER_SAFE 0 /* count of an output that is safe: after a reset, and when the host is gone */
#endif
#ifndef PLAYER_LOWEST
#define PLAYER_LOWEST 0 /* counts that the amplifier may be given */
#endif
#ifndef PLAYER_HIGHEST
#define PLAYER_HIGHEST 65535
#endif

/* Whether the amplifier may be given a count. */
static inline bool port_allows(uint16_t count)
{
#if PLAYER_LOWEST > 0 /* else a compiler warns that this is always so */
    if (count < PLAYER_LOWEST)
        return false;
#endif
#if PLAYER_HIGHEST < 65535
    if (count > PLAYER_HIGHEST)
        return false;
#endif
    (void)count;
    return true;
}

/* Lines in step with a play, as bits; LINE_PLAY is high from its first point to its end. */
enum line { LINE_POINT = 1, LINE_LINE = 2, LINE_FRAME = 4, LINE_PLAY = 8 };

/* What gives the time of the points. */
enum clock { CLOCK_NOW, CLOCK_START_ON_EDGE, CLOCK_STEP_ON_EDGE };

/* Samples all inputs, then sets all outputs, in this order: a sample shows the point before. */
void port_exchange(const uint16_t *out, uint16_t *in);

/* Calls player_tick for each point, until port_clock_stop. */
void port_clock_start(enum clock clock, uint32_t interval);
void port_clock_stop(void);

/* Whether each edge is told to player_edge. While it is, the pin is watched also beside CLOCK_START_ON_EDGE. */
void port_tell_edges(bool told);

/* Time in us; it goes through 0 after 2^32 - 1. */
uint32_t port_us(void);

/* Whether the next point is due already. */
bool port_tick_is_due(void);

void port_lines(uint8_t lines);

/* Sends a byte; may wait until the byte before it is on its way. Never called in a tick. */
void port_send(uint8_t byte);

/* Keeps ticks away from what they share with the main loop. */
void port_lock(void);
void port_unlock(void);

/* The name that a person gave to this board, up to PORT_NAME_SIZE characters; it survives a reset. */
void port_load_name(char *name);
void port_store_name(const char *name);

#endif
