/* The state of the board: who may drive its outputs, and what happens if the host is gone.
 * SPDX-License-Identifier: MIT */
#ifndef PLAYER_H
#define PLAYER_H

#include "port.h"

#define PLAYER_VERSION "1.2"
#define PLAYER_PROTOCOL 1

enum player_state { PLAYER_OFF, PLAYER_ON, PLAYER_PLAYING };

/* What happened since it was asked last, as bits. */
enum player_flag { FLAG_RESET = 1, FLAG_WATCHDOG = 2, FLAG_LATE = 4, FLAG_OVERRUN = 8 };

/* --- called by the port ------------------------------------------------------------------------ */

/* Makes all outputs safe. Call it as soon as the converters can be reached, before anything else. */
void player_start(void);

/* One point. Call it at each tick of the clock or edge; `late` if this one did not come in time. */
void player_tick(bool late);

/* An edge at the trigger input, by the time of port_us; `used` if it has started the clock. Call it soon after each
 * one while port_tell_edges asks for them, not in an interrupt that a tick may interrupt. */
void player_edge(uint32_t us, bool used);

/* Call it once per millisecond, not in an interrupt that a tick may interrupt. */
void player_millisecond(void);

/* A byte from the host. */
void player_byte(uint8_t byte);

/* A byte from the host was lost. */
void player_overrun(void);

/* --- called by the line protocol --------------------------------------------------------------- */

enum player_state player_state(void);
uint8_t player_flags(void);
void player_heard(void); /* the host is there */
void player_on(void);
void player_off(void);
void player_hold(void); /* ends a play where it is */
bool player_set(const uint16_t *out); /* false if a value is out of range */
void player_go(enum clock clock);
void player_set_watchdog(uint16_t ms); /* 0 for none */

/* The outputs in force, and the inputs: sampled now, or during a play at the last point. */
void player_read(uint16_t *out, uint16_t *in);

#endif
