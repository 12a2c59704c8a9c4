/* SPDX-License-Identifier: MIT */
#include "reply.h"

#include "crc16.h"
#include "port.h"

static uint16_t crc; /* of what was sent since the beginning */

static void send(uint8_t byte)
{
    crc = crc16_add(crc, byte);
    port_send(byte);
}

void reply_begin(void)
{
    crc = CRC16_BEGIN;
}

void reply_char(char c)
{
    send((uint8_t)c);
}

void reply_text(const char *text)
{
    while (*text)
        reply_char(*text++);
}

void reply_plain(uint32_t number)
{
    char digits[10];
    uint8_t n = 0;
    do {
        digits[n++] = (char)('0' + number % 10);
        number /= 10;
    } while (number);
    while (n)
        reply_char(digits[--n]);
}

void reply_number(uint32_t number)
{
    reply_char(' ');
    reply_plain(number);
}

void reply_end(bool checked)
{
    if (checked) {
        uint16_t sum = crc;
        reply_char('*');
        for (uint8_t shift = 16; shift; shift -= 4)
            reply_char("0123456789ABCDEF"[sum >> (shift - 4) & 15]);
    }
    port_send('\n');
}

void reply_value(uint16_t value)
{
    send((uint8_t)value);
    send((uint8_t)(value >> 8));
}

void reply_data_end(void)
{
    uint16_t sum = crc;
    reply_value(sum);
}
