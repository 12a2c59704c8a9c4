/* The table and its play: one point per tick, a record beside it, lines in step.
 * SPDX-License-Identifier: MIT */
#ifndef PLAY_H
#define PLAY_H

#include "port.h"

struct play_plan {
    uint16_t lead;     /* rows that are played once, before the period */
    uint16_t period;   /* rows that are repeated */
    uint32_t cycles;   /* how often */
    uint32_t interval; /* between two points, in ticks of PORT_CLOCK_HZ */
    uint32_t first;    /* point of the play, lead-in included, at which the record begins */
    uint16_t room;     /* rows of the record; play_prepare sets it */
};

/* Rows of the period, counted through all cycles, before which a play holds its outputs until an edge comes. */
struct play_waits {
    uint16_t first, every; /* every: rows from one to the next, at least 1 */
    uint16_t count;        /* 0: it waits nowhere */
};

struct play_edges {
    uint16_t seen;   /* edges so far */
    uint16_t stored; /* those of them whose time is known */
    bool waiting;    /* whether the play waits for one */
};
/* Pulses in step with the rows of the period, which has lines behind its first `skip` rows. */
struct play_lines {
    uint16_t point;  /* rows from a pulse of a point to the next one in a line; 0 for none */
    uint16_t line;   /* whether each line pulses at its first row */
    uint16_t length; /* rows from a line to the next one; 0: the period has one line */
    uint16_t active; /* rows of a line, from its beginning, in which points pulse */
    uint16_t skip;
    uint16_t frame;  /* rows from the first line in which the frame is high; PLAY_WHOLE for the whole play */
};
#define PLAY_WHOLE 65535u

/* Progress of the play that goes on, or of the last one. */
struct play_progress {
    uint32_t cycle; /* complete cycles */
    uint16_t kept;  /* recorded rows */
    bool late;      /* whether a point was late */
};

/* Writes a byte of the table; the table is not prepared any more. */
void play_store(uint16_t at, uint8_t byte);

/* Returns the CRC of the first rows of the table. */
uint16_t play_crc(uint16_t rows);

/* Returns a row with a value outside PLAYER_LOWEST to PLAYER_HIGHEST; `rows` if there is none. */
uint16_t play_outside(uint16_t rows);

/* Prepares a play; play_start repeats it as often as it is asked to. */
void play_prepare(const struct play_plan *plan);
bool play_is_prepared(void);

void play_set_lines(const struct play_lines *lines);

/* Waits of the plays that are prepared from now on. */
void play_set_waits(const struct play_waits *waits);

/* Rows that the times of edges take of the memory. */
uint16_t play_edge_rows(void);

/* The edges of this play, or of the last one. */
struct play_edges play_edges(void);

/* Returns the time of a stored edge since the start, in us, and whether the play waited for it. */
uint32_t play_edge(uint16_t at, bool *used);

/* Starts the prepared play from the outputs in force, which were sampled last as given. */
void play_start(enum clock clock, const uint16_t *out, const uint16_t *in);
bool play_is_going(void);

/* Stops where the play is; does nothing without a play. */
void play_stop(void);

struct play_progress play_progress(void);

/* The output and the sample of the last point; before the first one, those of play_start. */
void play_last(uint16_t *out, uint16_t *in);

/* Returns a recorded value; `at` counts values, row by row. */
uint16_t play_recorded(uint16_t at);

#endif
