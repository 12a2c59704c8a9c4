/* SPDX-License-Identifier: MIT */
#include "player.h"

#include "line.h"
#include "play.h"

#define CH PORT_CHANNELS
#define WATCHDOG_MS 1000 /* until the host asks for another time */
#define SAFE_STEP 262    /* counts per ms on the way to the safe value: from end to end in a quarter of a second */

static uint16_t out[CH], in[CH];
static uint8_t flags;
static bool on, plays; /* plays: a play was started, and its end not noticed yet */
static uint16_t watchdog_ms, quiet_ms;

void player_start(void)
{
    for (uint8_t i = 0; i < CH; i++)
        out[i] = PLAYER_SAFE;
    port_exchange(out, in);
    flags = FLAG_RESET;
    on = plays = false;
    watchdog_ms = WATCHDOG_MS;
}

/* Takes over the output at which a play has ended, or was stopped. */
static void follow_play(void)
{
    if (!plays || play_is_going())
        return;
    plays = false;
    play_last(out, in);
}

static void stop_play(void)
{
    play_stop();
    follow_play();
}

enum player_state player_state(void)
{
    follow_play();
    return !on ? PLAYER_OFF : plays ? PLAYER_PLAYING : PLAYER_ON;
}

uint8_t player_flags(void)
{
    uint8_t found = flags | (play_progress().late ? FLAG_LATE : 0);
    flags &= (uint8_t)~FLAG_OVERRUN; /* told once */
    return found;
}

void player_heard(void)
{
    quiet_ms = 0;
}

void player_on(void)
{
    on = true;
    flags = 0;
}

void player_off(void)
{
    stop_play();
    on = false;
    line_forget();
}

void player_hold(void)
{
    stop_play();
}

bool player_set(const uint16_t *wanted)
{
    for (uint8_t i = 0; i < CH; i++)
        if (!port_allows(wanted[i]))
            return false;
    for (uint8_t i = 0; i < CH; i++)
        out[i] = wanted[i];
    port_exchange(out, in);
    return true;
}

void player_go(enum clock clock)
{
    plays = true;
    play_start(clock, out, in);
}

void player_set_watchdog(uint16_t ms)
{
    watchdog_ms = ms;
}

void player_overrun(void)
{
    flags |= FLAG_OVERRUN;
}

void player_read(uint16_t *driven, uint16_t *seen)
{
    if (player_state() == PLAYER_PLAYING) {
        play_last(driven, seen);
        return;
    }
    port_exchange(out, in); /* the same outputs again: only a sample is new */
    for (uint8_t i = 0; i < CH; i++) {
        driven[i] = out[i];
        seen[i] = in[i];
    }
}

static void step_to_safe(void)
{
    bool moves = false;
    for (uint8_t i = 0; i < CH; i++) {
        uint16_t to = PLAYER_SAFE, from = out[i];
        if (from != to) {
            uint16_t left = from > to ? from - to : to - from;
            uint16_t step = left < SAFE_STEP ? left : SAFE_STEP;
            out[i] = from > to ? from - step : from + step;
            moves = true;
        }
    }
    if (moves)
        port_exchange(out, in);
}

void player_millisecond(void)
{
    line_millisecond();
    if (player_state() != PLAYER_OFF && watchdog_ms && ++quiet_ms > watchdog_ms) {
        player_off();
        flags |= FLAG_WATCHDOG;
    }
    if (!on)
        step_to_safe();
}
