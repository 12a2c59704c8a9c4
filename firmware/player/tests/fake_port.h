/* A port without a board: tests look at what the core does to it.
 * SPDX-License-Identifier: MIT */
#ifndef FAKE_PORT_H
#define FAKE_PORT_H

#include "port.h"

struct fake {
    uint16_t out[PORT_CHANNELS], in[PORT_CHANNELS];
    unsigned exchanges;
    bool clock_runs, tick_is_due, edges_told;
    uint32_t us;
    enum clock clock;
    uint32_t interval;
    unsigned points, lines, frames; /* rising edges of the three lines */
    uint8_t levels;
    char sent[8192];
    unsigned n_sent;
    char name[PORT_NAME_SIZE + 1];
    int locks;
};

extern struct fake fake;

/* Sends a line to the core, and returns what it answers. */
const char *ask(const char *line);

/* As ask, with a checksum, which is checked and taken off the answer. */
const char *ask_checked(const char *line);

/* Writes a table of `rows` rows from row `first` on, with the values first row * 10, 10 more for each value. */
void write_rows(unsigned first, unsigned rows);

/* Returns the checksum of the first rows of such a table. */
unsigned crc_of_rows(unsigned rows);

#endif
