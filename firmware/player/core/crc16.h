/* CRC-16/CCITT-FALSE: polynomial 0x1021, begins with 0xFFFF, most significant bit first.
 * SPDX-License-Identifier: MIT */
#ifndef CRC16_H
#define CRC16_H

#include <stdint.h>

#define CRC16_BEGIN 0xFFFFu

static inline uint16_t crc16_add(uint16_t crc, uint8_t byte)
{
    /* The eight steps of the usual loop at once: without a table, and in few cycles on 8 bits. */
    uint8_t x = (uint8_t)(crc >> 8) ^ byte;
    x ^= x >> 4;
    return (uint16_t)((crc << 8) ^ ((uint16_t)x << 12) ^ ((uint16_t)x << 5) ^ x);
}

#endif
