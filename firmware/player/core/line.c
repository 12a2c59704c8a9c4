/* SPDX-License-Identifier: MIT */
#include "line.h"

#include "commands.h"
#include "crc16.h"
#include "play.h"
#include "player.h"
#include "reply.h"
#include "text.h"

#define MOST 63       /* characters of a request */
#define MOST_TAG 4
#define SILENT_MS 200 /* longest pause within data */

static char line[MOST + 1];
static uint8_t length;
static bool too_long;
static char tag[MOST_TAG + 3]; /* what the reply begins with: the sign, the tag, a space and the end */
static bool checked;           /* whether this request has a checksum */
static bool checked_only;      /* a host that sends checksums never leaves one out: without one, bytes were lost */

/* Data that come after a request. */
static struct {
    uint16_t at, left, crc; /* byte of the table, bytes to come with the CRC, the CRC up to here */
    uint8_t silent_ms;
} data;

static void begin_reply(void)
{
    reply_begin();
    reply_text(tag);
}

static void send_error(const char *error)
{
    begin_reply();
    reply_text("E ");
    reply_text(error);
    reply_end(checked);
}

/* Takes the checksum off the line; returns an error. */
static const char *check(void)
{
    uint16_t found, crc = CRC16_BEGIN;
    char *end = line;
    while (*end && *end != '*')
        crc = crc16_add(crc, (uint8_t)*end++);
    checked = *end == '*';
    if (!checked)
        return checked_only ? "crc" : 0;
    if (!text_hex(end + 1, &found) || found != crc)
        return "crc";
    *end = 0;
    checked_only = true;
    return 0;
}

/* Returns the request behind the tag, which the reply will repeat. */
static const char *without_tag(const char *request)
{
    uint8_t n = 0;
    tag[0] = 0;
    if (*request != '@')
        return request;
    while (n <= MOST_TAG && request[n] && request[n] != ' ')
        n++;
    if (request[n] != ' ')
        return request; /* no tag: an unknown request */
    for (uint8_t i = 0; i <= n; i++)
        tag[i] = request[i];
    tag[n + 1] = 0;
    return request + n + 1;
}

static void take_line(void)
{
    const char *error = check();
    const char *request = without_tag(line);
    if (too_long)
        error = "long";
    if (error) {
        send_error(error);
        return;
    }
    player_heard();
    begin_reply();
    error = command_run(request);
    if (error) {
        reply_text("E ");
        reply_text(error);
    }
    reply_end(checked);
    if (!error)
        command_send_data();
}

void line_expect(uint16_t at, uint16_t bytes)
{
    data.at = at;
    data.left = bytes + 2;
    data.crc = CRC16_BEGIN;
    data.silent_ms = 0;
}

static void take_data(uint8_t byte)
{
    data.silent_ms = 0;
    data.left--;
    if (data.left >= 2) {
        play_store(data.at++, byte);
        data.crc = crc16_add(data.crc, byte);
    } else if (data.left == 1) {
        data.crc ^= byte; /* little-endian: 0 remains if both bytes are right */
    } else {
        data.crc ^= (uint16_t)(byte << 8);
        player_heard();
        if (data.crc) {
            send_error("crc");
        } else {
            begin_reply();
            reply_text("T ok");
            reply_end(checked);
        }
    }
}

void player_byte(uint8_t byte)
{
    if (data.left) {
        take_data(byte);
    } else if (byte == '\n') {
        line[length] = 0;
        if (length || too_long)
            take_line();
        length = 0;
        too_long = false;
    } else if (byte != '\r') {
        if (length < MOST)
            line[length++] = (char)byte;
        else
            too_long = true;
    }
}

void line_millisecond(void)
{
    if (data.left && ++data.silent_ms > SILENT_MS) {
        data.left = 0;
        send_error("short");
    }
}

void line_forget(void)
{
    checked_only = false;
}
