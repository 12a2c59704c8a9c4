/* The requests, by their first word.
 * SPDX-License-Identifier: MIT */
#ifndef COMMANDS_H
#define COMMANDS_H

/* Executes a request and writes its reply; returns the reason of a refusal instead, before it has written anything. */
const char *command_run(const char *request);

/* Sends the data that were asked for, behind the line of the reply. */
void command_send_data(void);

#endif
