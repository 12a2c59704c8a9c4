/* SPDX-License-Identifier: MIT */
#include "text.h"

bool text_number(const char **at, uint32_t most, uint32_t *number)
{
    const char *c = *at;
    uint32_t n = 0;
    if (*c++ != ' ' || *c < '0' || *c > '9')
        return false;
    for (; *c >= '0' && *c <= '9'; c++) {
        uint8_t digit = (uint8_t)(*c - '0');
        if (n > (most - digit) / 10)
            return false;
        n = n * 10 + digit;
    }
    *at = c;
    *number = n;
    return true;
}

bool text_count(const char **at, uint16_t *count)
{
    uint32_t n;
    if (!text_number(at, 65535, &n))
        return false;
    *count = (uint16_t)n;
    return true;
}

bool text_word(const char **at, const char *word)
{
    const char *c = *at;
    if (*c == ' ')
        c++;
    while (*word)
        if (*c++ != *word++)
            return false;
    if (*c && *c != ' ')
        return false;
    *at = c;
    return true;
}

bool text_ends(const char *at)
{
    return *at == 0;
}

static int8_t digit_of(char c)
{
    if (c >= '0' && c <= '9')
        return (int8_t)(c - '0');
    if (c >= 'A' && c <= 'F')
        return (int8_t)(c - 'A' + 10);
    return -1;
}

bool text_hex(const char *at, uint16_t *number)
{
    uint16_t n = 0;
    for (uint8_t i = 0; i < 4; i++) {
        int8_t digit = digit_of(at[i]);
        if (digit < 0)
            return false;
        n = (uint16_t)(n << 4 | (uint16_t)digit);
    }
    *number = n;
    return at[4] == 0;
}
