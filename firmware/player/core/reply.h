/* Sends replies, character by character, with a checksum behind.
 * SPDX-License-Identifier: MIT */
#ifndef REPLY_H
#define REPLY_H

#include <stdbool.h>
#include <stdint.h>

void reply_begin(void);
void reply_char(char c);
void reply_text(const char *text);
void reply_plain(uint32_t number);
void reply_number(uint32_t number); /* behind a space */
void reply_end(bool checked);

/* Binary data, behind reply_begin: little-endian values, then their CRC. */
void reply_value(uint16_t value);
void reply_data_end(void);

#endif
