/* SPDX-License-Identifier: MIT */
#include "fake_port.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "crc16.h"
#include "player.h"

struct fake fake;

void port_exchange(const uint16_t *out, uint16_t *in)
{
    for (unsigned i = 0; i < PORT_CHANNELS; i++) {
        in[i] = (uint16_t)(fake.out[i] + 1); /* a stage that follows at once: the sample shows the output before */
        fake.in[i] = in[i];
        fake.out[i] = out[i];
    }
    fake.exchanges++;
}

void port_clock_start(enum clock clock, uint32_t interval)
{
    fake.clock_runs = true;
    fake.clock = clock;
    fake.interval = interval;
}

void port_tell_edges(bool told)
{
    fake.edges_told = told;
}

uint32_t port_us(void)
{
    return fake.us;
}

void port_clock_stop(void)
{
    fake.clock_runs = false;
}

bool port_tick_is_due(void)
{
    return fake.tick_is_due;
}

void port_lines(uint8_t lines)
{
    uint8_t risen = lines & (uint8_t)~fake.levels;
    fake.points += (risen & LINE_POINT) != 0;
    fake.lines += (risen & LINE_LINE) != 0;
    fake.frames += (risen & LINE_FRAME) != 0;
    fake.levels = lines;
}

void port_send(uint8_t byte)
{
    assert(fake.locks == 0); /* sending may wait, and ticks may not */
    assert(fake.n_sent < sizeof fake.sent - 1);
    fake.sent[fake.n_sent++] = (char)byte;
    fake.sent[fake.n_sent] = 0;
}

void port_lock(void)
{
    assert(fake.locks++ == 0);
}

void port_unlock(void)
{
    assert(--fake.locks == 0);
}

void port_load_name(char *name)
{
    strcpy(name, fake.name);
}

void port_store_name(const char *name)
{
    strcpy(fake.name, name);
}

const char *ask(const char *line)
{
    fake.n_sent = 0;
    fake.sent[0] = 0;
    while (*line)
        player_byte((uint8_t)*line++);
    player_byte('\n');
    return fake.sent;
}

static uint16_t crc_of(const char *text, size_t n)
{
    uint16_t crc = CRC16_BEGIN;
    for (size_t i = 0; i < n; i++)
        crc = crc16_add(crc, (uint8_t)text[i]);
    return crc;
}

const char *ask_checked(const char *line)
{
    char whole[128], sum[8];
    snprintf(whole, sizeof whole, "%s*%04X", line, crc_of(line, strlen(line)));
    ask(whole);
    char *star = strchr(fake.sent, '*');
    assert(star);
    snprintf(sum, sizeof sum, "*%04X\n", crc_of(fake.sent, (size_t)(star - fake.sent)));
    assert(strncmp(star, sum, 6) == 0);
    *star = 0;
    return fake.sent;
}

static uint16_t value(unsigned at)
{
    return (uint16_t)(1000 + 10 * at);
}

static uint16_t send_value(uint16_t count, uint16_t crc)
{
    player_byte((uint8_t)count);
    player_byte((uint8_t)(count >> 8));
    return crc16_add(crc16_add(crc, (uint8_t)count), (uint8_t)(count >> 8));
}

void write_rows(unsigned first, unsigned rows)
{
    char line[32];
    uint16_t crc = CRC16_BEGIN;
    snprintf(line, sizeof line, "T %u %u", first, rows);
    const char *answer = ask(line);
    assert(strcmp(answer, "T go\n") == 0);
    for (unsigned i = 0; i < rows * PORT_CHANNELS; i++)
        crc = send_value(value(first * PORT_CHANNELS + i), crc);
    fake.n_sent = 0;
    send_value(crc, crc);
    assert(strcmp(fake.sent, "T ok\n") == 0);
}

unsigned crc_of_rows(unsigned rows)
{
    uint16_t crc = CRC16_BEGIN;
    for (unsigned i = 0; i < rows * PORT_CHANNELS; i++)
        crc = crc16_add(crc16_add(crc, (uint8_t)value(i)), (uint8_t)(value(i) >> 8));
    return crc;
}
