/* The line protocol: a request per line, a reply per request.
 * SPDX-License-Identifier: MIT */
#ifndef LINE_H
#define LINE_H

#include <stdint.h>

/* Ends a request for data that do not come. */
void line_millisecond(void);

/* Takes the next bytes as data of the table: `bytes` from byte `at` on, then their CRC. */
void line_expect(uint16_t at, uint16_t bytes);

/* Takes requests without a checksum again. */
void line_forget(void);

#endif
