/* SPDX-License-Identifier: MIT */
#include "play.h"

#include "crc16.h"
#include "player.h"

#define CH PORT_CHANNELS

static uint16_t memory[PORT_MEMORY_ROWS * CH] PORT_NOINIT; /* the table, and behind it the record */
static struct play_plan plan;
static bool prepared;
static struct play_lines pulsed = {.active = PLAY_WHOLE, .frame = PLAY_WHOLE};

/* Only a tick changes these while a play goes on; it has worked out the next point beforehand, so that the output
 * changes a fixed time after the edge of the clock. */
static struct {
    volatile bool going, late;
    volatile uint32_t cycle;
    volatile uint16_t kept;
    const uint16_t *row;    /* row of the table that comes next */
    uint16_t rows_left;     /* of the lead-in or of the period, this one included */
    bool in_lead, last;     /* last: the point that comes next is the last one */
    uint32_t until_record;  /* points */
    uint16_t *free;         /* where the next sample goes */
    uint16_t until_point, until_line, of_line, of_frame; /* rows; of_: that are left in which it may pulse */
    uint8_t lines;          /* of the point that comes next */
    uint16_t out[CH]; /* of the point that comes next */
    uint16_t driven[CH], in[CH]; /* of the last point */
} now;

void play_store(uint16_t at, uint8_t byte)
{
    uint16_t *word = &memory[at / 2];
    prepared = false;
    if (at % 2)
        *word = (uint16_t)((*word & 0x00FFu) | (unsigned)byte << 8);
    else
        *word = (uint16_t)((*word & 0xFF00u) | byte);
}

uint16_t play_crc(uint16_t rows)
{
    uint16_t crc = CRC16_BEGIN;
    for (uint16_t i = 0; i < rows * CH; i++) {
        crc = crc16_add(crc, (uint8_t)memory[i]);
        crc = crc16_add(crc, (uint8_t)(memory[i] >> 8));
    }
    return crc;
}

uint16_t play_outside(uint16_t rows)
{
    for (uint16_t i = 0; i < rows * CH; i++)
        if (!port_allows(memory[i]))
            return i / CH;
    return rows;
}

void play_prepare(const struct play_plan *wanted)
{
    plan = *wanted;
    plan.room = (uint16_t)(PORT_MEMORY_ROWS - plan.lead - plan.period);
    prepared = true;
}

bool play_is_prepared(void)
{
    return prepared;
}

void play_set_lines(const struct play_lines *lines)
{
    pulsed = *lines;
}

/* Returns the lines of a row of the period. */
static uint8_t row_lines(void)
{
    uint8_t lines = 0;
    if (--now.until_line == 0) {
        if (pulsed.line)
            lines |= LINE_LINE;
        now.until_line = pulsed.length;
        now.until_point = 1;
        now.of_line = pulsed.active;
    }
    if (now.of_line) {
        now.of_line--;
        if (pulsed.point && --now.until_point == 0) {
            lines |= LINE_POINT;
            now.until_point = pulsed.point;
        }
    }
    if (now.of_frame) {
        now.of_frame--;
        lines |= LINE_FRAME;
    }
    return lines;
}

static void begin_row(void)
{
    for (uint8_t i = 0; i < CH; i++)
        now.out[i] = now.row[i];
    now.lines = pulsed.frame == PLAY_WHOLE ? LINE_PLAY | LINE_FRAME : LINE_PLAY;
    now.last = false;
    if (now.in_lead)
        return;
    now.lines |= row_lines();
    now.last = now.rows_left == 1 && now.cycle + 1 == plan.cycles;
}

static void begin_period(void)
{
    now.in_lead = false;
    now.row = &memory[plan.lead * CH];
    now.rows_left = plan.period;
    now.until_line = pulsed.skip + 1;
    now.of_line = 0;
    begin_row();
}

/* Works out the next point. */
static void advance(void)
{
    if (--now.rows_left) {
        now.row += CH;
        begin_row();
        return;
    }
    if (!now.in_lead)
        now.cycle++;
    begin_period();
}

static void keep(void)
{
    if (now.until_record) {
        now.until_record--;
    } else if (now.kept < plan.room) {
        for (uint8_t i = 0; i < CH; i++)
            *now.free++ = now.in[i];
        now.kept++;
    }
}

void player_tick(bool late)
{
    if (!now.going)
        return;
    port_lines(now.lines);
    port_exchange(now.out, now.in);
    for (uint8_t i = 0; i < CH; i++)
        now.driven[i] = now.out[i];
    keep();
    if (now.last) {
        now.cycle++;
        now.going = false;
        port_clock_stop();
        port_lines(0);
        return;
    }
    port_lines(now.lines & (LINE_PLAY | LINE_FRAME));
    advance();
    if (late || port_tick_is_due())
        now.late = true;
}

void play_start(enum clock clock, const uint16_t *out, const uint16_t *in)
{
    for (uint8_t i = 0; i < CH; i++) {
        now.driven[i] = out[i];
        now.in[i] = in[i];
    }
    now.cycle = 0;
    now.kept = 0;
    now.late = now.last = false;
    now.until_record = plan.first;
    now.of_frame = pulsed.frame == PLAY_WHOLE ? 0 : pulsed.frame;
    now.lines = 0;
    now.free = &memory[(plan.lead + plan.period) * CH];
    now.row = memory;
    if (plan.lead) {
        now.in_lead = true;
        now.rows_left = plan.lead;
        begin_row();
    } else {
        begin_period();
    }
    now.going = true;
    port_clock_start(clock, plan.interval);
}

bool play_is_going(void)
{
    return now.going;
}

void play_stop(void)
{
    port_clock_stop();
    now.going = false;
    port_lines(0);
}

struct play_progress play_progress(void)
{
    struct play_progress found;
    port_lock();
    found.cycle = now.cycle;
    found.kept = now.kept;
    found.late = now.late;
    port_unlock();
    return found;
}

void play_last(uint16_t *out, uint16_t *in)
{
    port_lock();
    for (uint8_t i = 0; i < CH; i++) {
        out[i] = now.driven[i];
        in[i] = now.in[i];
    }
    port_unlock();
}

uint16_t play_recorded(uint16_t at)
{
    return memory[(plan.lead + plan.period) * CH + at];
}
