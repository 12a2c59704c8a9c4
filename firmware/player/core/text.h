/* Reads the words of a request.
 * SPDX-License-Identifier: MIT */
#ifndef TEXT_H
#define TEXT_H

#include <stdbool.h>
#include <stdint.h>

/* Reads a space and a decimal number up to `most`; false, and `at` stays, if there is none. */
bool text_number(const char **at, uint32_t most, uint32_t *number);

/* As text_number, for a value of 16 bits. */
bool text_count(const char **at, uint16_t *count);

/* Reads a word at the beginning, or behind a space; it must be followed by a space or the end. */
bool text_word(const char **at, const char *word);

bool text_ends(const char *at);

/* Reads exactly four hexadecimal digits. */
bool text_hex(const char *at, uint16_t *number);

#endif
