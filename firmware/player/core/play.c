/* SPDX-License-Identifier: MIT */
#include "play.h"

#include "crc16.h"
#include "player.h"

#define CH PORT_CHANNELS

static uint16_t memory[PORT_MEMORY_ROWS * CH] PORT_NOINIT; /* the table, and behind it the record */
static struct play_plan plan;
static bool prepared;
static struct play_lines pulsed = {.active = PLAY_WHOLE, .frame = PLAY_WHOLE};
static struct play_waits waits;

#define SPARE 16 /* edges that come too often, and are stored */
#define EDGE_WORDS 2

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
    bool framed;            /* whether a line has begun, with which the frame begins */
    uint8_t lines;          /* of the point that comes next */
    uint32_t until_wait;    /* rows of the period */
    uint16_t waits_left;
    bool gate;              /* whether an edge has to come before the point that comes next */
    volatile uint16_t waits; /* so far */
    uint16_t out[CH]; /* of the point that comes next */
    uint16_t driven[CH], in[CH]; /* of the last point */
} now;

/* The main loop changes these while a play goes on. */
static struct {
    uint32_t began;      /* us */
    uint16_t seen, used, stored;
    uint16_t *last;      /* stored one; they grow down from the end of the memory */
} edges;

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
    plan.room = (uint16_t)(PORT_MEMORY_ROWS - plan.lead - plan.period - play_edge_rows());
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
        now.framed = true;
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
    if (now.framed && now.of_frame) {
        now.of_frame--;
        lines |= LINE_FRAME;
    }
    return lines;
}

void play_set_waits(const struct play_waits *wanted)
{
    waits = *wanted;
    prepared = false;
}

uint16_t play_edge_rows(void)
{
    return waits.count ? (uint16_t)(((uint32_t)(waits.count + SPARE) * EDGE_WORDS + CH - 1) / CH) : 0;
}

struct play_edges play_edges(void)
{
    struct play_edges found = {.seen = edges.seen, .stored = edges.stored};
    port_lock();
    found.waiting = now.going && now.waits != edges.used;
    port_unlock();
    return found;
}

/* An edge is stored as its time, whose lowest bit tells whether it was used. */
uint32_t play_edge(uint16_t at, bool *used)
{
    const uint16_t *words = &memory[PORT_MEMORY_ROWS * CH - (at + 1) * EDGE_WORDS];
    *used = words[0] & 1u;
    return (uint32_t)words[1] << 16 | (words[0] & 0xFFFEu);
}

void player_edge(uint32_t us, bool used)
{
    if (!now.going)
        return;
    edges.seen++;
    edges.used += used;
    if (!used && edges.stored - edges.used == SPARE)
        return;
    us -= edges.began;
    edges.last -= EDGE_WORDS;
    edges.last[0] = (uint16_t)((us & 0xFFFEu) | used);
    edges.last[1] = (uint16_t)(us >> 16);
    edges.stored++;
}

/* Holds the outputs until an edge comes, which the point of the gate follows at once. */
static void wait_for_edge(void)
{
    now.gate = false;
    now.waits++;
    port_clock_start(CLOCK_START_ON_EDGE, plan.interval);
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
    if (now.waits_left && --now.until_wait == 0) {
        now.gate = true;
        now.waits_left--;
        now.until_wait = waits.every;
    }
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
    if (now.gate) {
        port_clock_stop();
        wait_for_edge();
        return;
    }
    port_lines(now.lines);
    port_exchange(now.out, now.in);
    for (uint8_t i = 0; i < CH; i++)
        now.driven[i] = now.out[i];
    keep();
    if (now.last) {
        now.cycle++;
        play_stop();
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
    now.late = now.last = now.gate = false;
    now.waits_left = waits.count;
    now.until_wait = waits.first + 1u;
    now.waits = 0;
    edges.seen = edges.used = edges.stored = 0;
    edges.last = &memory[PORT_MEMORY_ROWS * CH];
    edges.began = port_us();
    now.until_record = plan.first;
    now.of_frame = pulsed.frame == PLAY_WHOLE ? 0 : pulsed.frame;
    now.framed = false;
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
    port_tell_edges(waits.count > 0);
    if (now.gate) {
        wait_for_edge();
        return;
    }
    now.waits = clock == CLOCK_START_ON_EDGE;
    port_clock_start(clock, plan.interval);
}

bool play_is_going(void)
{
    return now.going;
}

void play_stop(void)
{
    port_tell_edges(false);
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
