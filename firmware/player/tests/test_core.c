/* Tests of the core on the host: each function states a fact.
 * SPDX-License-Identifier: MIT */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "crc16.h"
#include "fake_port.h"
#include "player.h"

static void wait_ms(unsigned ms)
{
    while (ms--)
        player_millisecond();
}

static void tick(unsigned n)
{
    while (n-- && fake.clock_runs)
        player_tick(false);
}

static void expect(const char *line, const char *answer)
{
    const char *found = ask(line);
    if (strcmp(found, answer)) {
        fprintf(stderr, "%s: answered %s, expected %s", line, found, answer);
        abort();
    }
}

static const char *prepare(unsigned lead, unsigned period, unsigned cycles, unsigned first)
{
    static char line[64];
    write_rows(0, lead + period);
    snprintf(line, sizeof line, "P %u %u %u 20 %u %04X", lead, period, cycles, first, crc_of_rows(lead + period));
    return ask(line);
}

static void crc_is_that_of_the_catalogue(void)
{
    uint16_t crc = CRC16_BEGIN;
    for (const char *c = "123456789"; *c; c++)
        crc = crc16_add(crc, (uint8_t)*c);
    assert(crc == 0x29B1);
}

static void outputs_are_safe_from_the_start(void)
{
    assert(fake.exchanges == 1 && fake.out[0] == 100 && fake.out[1] == 100);
    expect("V 200 300", "E off\n");
    expect("?", "S off r 100 100 101 101 0 0\n");
    assert(fake.out[0] == 100);
}

static void a_set_point_is_in_force_and_sampled(void)
{
    expect("ON", "S on - 100 100 101 101 0 0\n");
    expect("V 200 300", "S on - 200 300 201 301 0 0\n");
    assert(fake.out[0] == 200 && fake.out[1] == 300);
}

static void requests_that_make_no_sense_change_nothing(void)
{
    static const char *const wrong[][2] = {
        {"V 200", "E syntax\n"}, {"V 200 300 400", "E syntax\n"}, {"V 200 -3", "E syntax\n"},
        {"V 200 300x", "E syntax\n"}, {"V  200 300", "E syntax\n"}, {"V 49 300", "E range\n"},
        {"V 200 60001", "E range\n"}, {"V 65536 300", "E range\n"}, {"V 4294967296 300", "E syntax\n"},
        {"X", "E unknown\n"}, {"VV 1 1", "E unknown\n"}, {" ?", "E unknown\n"}, {"@12345 ?", "E unknown\n"},
        {"T 0 0", "E memory\n"}, {"T 0 129", "E memory\n"}, {"T 299 2", "E memory\n"}, {"R 0 1", "E memory\n"},
        {"G", "E table\n"}, {"G x", "E syntax\n"}, {"N name", "E busy\n"}, {"W 65536", "E syntax\n"},
    };
    ask("ON");
    ask("V 200 300");
    for (unsigned i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        expect(wrong[i][0], wrong[i][1]);
    assert(fake.out[0] == 200 && fake.out[1] == 300);
}

static void a_long_line_is_refused_as_a_whole(void)
{
    char line[200];
    memset(line, ' ', sizeof line);
    memcpy(line, "?", 1);
    line[150] = 0;
    expect(line, "E long\n");
    expect("?", "S off r 100 100 101 101 0 0\n");
}

static void checksums_are_asked_for_once_they_were_seen(void)
{
    assert(strcmp(ask_checked("@ab ON"), "@ab S on - 100 100 101 101 0 0") == 0);
    expect("V 200 300", "E crc\n");
    ask("V 200 300*0000");
    assert(strncmp(fake.sent, "E crc*", 6) == 0 && fake.out[0] == 100);
    ask_checked("OFF");
    expect("?", "S off - 100 100 101 101 0 0\n");
}

static void a_play_gives_each_row_in_order_and_records_beside(void)
{
    ask("ON");
    assert(strncmp(prepare(2, 3, 4, 0), "S on", 4) == 0);
    expect("L 2 3", "S on - 100 100 101 101 0 0\n");
    ask("G");
    assert(fake.clock_runs && fake.interval == 20 && fake.clock == CLOCK_NOW);
    for (unsigned i = 0; i < 14; i++) {
        unsigned row = i < 2 ? i : 2 + (i - 2) % 3;
        assert(fake.clock_runs);
        player_tick(false);
        assert(fake.out[0] == 1000 + 20 * row && fake.out[1] == 1010 + 20 * row);
    }
    assert(!fake.clock_runs && fake.levels == 0);
    assert(fake.points == 8 && fake.lines == 4 && fake.frames == 1);
    expect("?", "S on - 1080 1090 1081 1091 4 14\n");
    ask("R 0 14");
    assert(strncmp(fake.sent, "R 0 14\n", 7) == 0 && fake.n_sent == 7 + 14 * 4 + 2);
    /* The first sample shows the output before the play, the second one the first row. */
    assert((uint8_t)fake.sent[7] == 101 && (uint8_t)fake.sent[11] == (1001 & 255));
}

static void lines_pulse_where_they_are_asked_to(void)
{
    ask("ON");
    prepare(2, 9, 2, 0);
    /* Lines at rows 2 and 6 of 9, points at the first and third row of the first 3 of each line. */
    expect("L 2 1 4 3 2 5", "S on - 100 100 101 101 0 0\n");
    ask("G");
    while (fake.clock_runs)
        player_tick(false);
    assert(fake.points == 8 && fake.lines == 4 && fake.frames == 1 && fake.levels == 0);
    prepare(2, 9, 2, 0);
    ask("L 0 0 0 0 0 0");
    ask("G");
    while (fake.clock_runs)
        player_tick(false);
    assert(fake.points == 8 && fake.lines == 4 && fake.frames == 1);
    expect("L 1 2 3", "E syntax\n");
}

static void a_record_begins_where_it_is_asked_to(void)
{
    ask("ON");
    prepare(0, 10, 100, 990);
    ask("G");
    tick(1000);
    expect("?", "S on - 1180 1190 1181 1191 100 10\n");
}

static void a_record_ends_where_the_memory_ends(void)
{
    ask("ON");
    prepare(0, 10, 100, 0);
    ask("G");
    tick(1000);
    expect("?", "S on - 1180 1190 1181 1191 100 290\n");
}

static void a_play_keeps_set_points_out(void)
{
    ask("ON");
    prepare(0, 10, 100, 0);
    ask("G");
    tick(5);
    expect("V 200 300", "E busy\n");
    expect("T 0 1", "E busy\n");
    expect("G", "E busy\n");
    expect("ON", "E busy\n");
    expect("R 0 1", "E busy\n");
    expect("A", "S on - 1080 1090 1081 1091 0 5\n");
    assert(!fake.clock_runs && fake.out[0] == 1080);
    expect("V 200 300", "S on - 200 300 201 301 0 5\n");
}

static void a_late_point_is_told(void)
{
    ask("ON");
    prepare(0, 10, 2, 0);
    ask("G");
    tick(5);
    fake.tick_is_due = true;
    tick(1);
    fake.tick_is_due = false;
    tick(20);
    assert(strncmp(ask("?"), "S on l ", 7) == 0);
    ask("G");
    assert(strncmp(ask("?"), "S play - ", 9) == 0);
    player_tick(true);
    assert(strncmp(ask("?"), "S play l ", 9) == 0);
}

static void an_edge_starts_or_steps(void)
{
    ask("ON");
    prepare(0, 10, 2, 0);
    ask("G start");
    assert(fake.clock == CLOCK_START_ON_EDGE);
    expect("?", "S play - 100 100 101 101 0 0\n");
    expect("A", "S on - 100 100 101 101 0 0\n");
    ask("G step");
    assert(fake.clock == CLOCK_STEP_ON_EDGE);
}

static void edge_at(uint32_t us)
{
    assert(fake.edges_told);
    player_edge(us, fake.clock == CLOCK_START_ON_EDGE);
    fake.clock = CLOCK_NOW;
}

static void a_play_waits_for_edges_and_counts_those_that_come_too_early(void)
{
    ask("ON");
    expect("E 2 4 2", "S on - 100 100 101 101 0 0\n");
    prepare(0, 10, 1, 0);
    fake.us = 1000;
    ask("G");
    tick(2);
    assert(fake.clock == CLOCK_NOW);
    edge_at(1010); /* too early: the interval of the second point is not over */
    tick(1);
    assert(fake.clock == CLOCK_START_ON_EDGE && fake.out[0] == 1020);
    expect("K", "K 1 1 1\n");
    edge_at(5000);
    tick(4);
    assert(fake.out[0] == 1100);
    expect("K", "K 2 2 0\n");
    tick(1);
    assert(fake.out[0] == 1100);
    expect("K", "K 2 2 1\n");
    edge_at(70002);
    tick(4);
    expect("?", "S on - 1180 1190 1181 1191 1 10\n");
    assert(!fake.edges_told);
    expect("K 0", "K 10 0\n");
    expect("K 1", "K 4000 1\n");
    expect("K 2", "K 69002 1\n");
    expect("K 3", "E memory\n");
    expect("E 0 0 1", "E range\n");
}

static void an_edge_starts_the_first_row(void)
{
    ask("ON");
    ask("E 0 1 1");
    prepare(0, 10, 2, 0);
    ask("G");
    assert(fake.clock == CLOCK_START_ON_EDGE);
    expect("K", "K 0 0 1\n");
    ask("A");
    expect("G step", "E range\n");
    ask("G start");
    expect("K", "K 0 0 1\n");
    edge_at(500);
    expect("K", "K 1 1 0\n");
    tick(20);
    expect("?", "S on - 1180 1190 1181 1191 2 20\n");
}

static void edges_that_come_too_often_take_no_room_from_others(void)
{
    ask("ON");
    ask("E 2 2 3");
    prepare(0, 10, 1, 0);
    ask("G");
    for (unsigned i = 0; i < 100; i++)
        edge_at(10 * i);
    tick(3);
    edge_at(2000);
    tick(3);
    edge_at(3000);
    expect("K", "K 102 18 0\n");
    tick(3);
    edge_at(4000);
    tick(4);
    expect("K", "K 103 19 0\n");
    expect("K 18", "K 4000 1\n");
    expect("?", "S on - 1180 1190 1181 1191 1 10\n");
}

static void a_table_that_differs_is_not_played(void)
{
    ask("ON");
    write_rows(0, 10);
    expect("P 0 10 2 20 0 1234", "E table\n");
    expect("G", "E table\n");
    assert(strncmp(prepare(0, 10, 2, 0), "S on", 4) == 0);
    write_rows(5, 5);
    expect("G", "E table\n");
}

static void a_plan_that_does_not_fit_is_refused(void)
{
    char line[64];
    static const char *const wrong[] = {"0 10 2 9 0", "0 10 2 1001 0", "0 10 0 20 0"};
    write_rows(0, 10);
    for (unsigned i = 0; i < 3; i++) {
        snprintf(line, sizeof line, "P %s %04X", wrong[i], crc_of_rows(10));
        expect(line, "E range\n");
    }
    expect("P 0 0 2 20 0 0000", "E memory\n");
    expect("P 1 300 2 20 0 0000", "E memory\n");
    expect("P 301 1 2 20 0 0000", "E memory\n");
    expect("P 0 10 2 20 0 12G4", "E syntax\n");
}

static void a_table_out_of_range_is_refused(void)
{
    uint16_t crc = CRC16_BEGIN;
    char line[64];
    ask("T 0 1");
    for (unsigned i = 0; i < 4; i++) {
        player_byte(0xFF);
        crc = crc16_add(crc, 0xFF);
    }
    player_byte((uint8_t)crc);
    player_byte((uint8_t)(crc >> 8));
    snprintf(line, sizeof line, "P 0 1 1 20 0 %04X", crc);
    expect(line, "E range\n");
}

static void half_a_table_is_given_up(void)
{
    ask("@1 T 0 2");
    for (unsigned i = 0; i < 5; i++)
        player_byte('?');
    fake.n_sent = 0;
    wait_ms(200);
    assert(fake.n_sent == 0);
    wait_ms(1);
    assert(strcmp(fake.sent, "@1 E short\n") == 0);
    assert(strncmp(ask("?"), "S off r ", 8) == 0);
}

static void a_flipped_bit_in_a_table_is_told(void)
{
    ask("T 0 1");
    fake.n_sent = 0;
    for (unsigned i = 0; i < 6; i++)
        player_byte(0x55);
    assert(strcmp(fake.sent, "E crc\n") == 0);
}

static void a_silent_host_ends_in_the_safe_value(void)
{
    ask("ON");
    ask("V 1000 100");
    wait_ms(1000);
    assert(fake.out[0] == 1000);
    wait_ms(1);
    assert(fake.out[0] == 1000 - 262);
    wait_ms(3);
    assert(fake.out[0] == 100);
    expect("?", "S off w 100 100 101 101 0 0\n");
    expect("V 200 300", "E off\n");
    expect("ON", "S on - 100 100 101 101 0 0\n");
}

static void a_silent_host_ends_a_play(void)
{
    ask("ON");
    prepare(0, 10, 1000000, 0);
    ask("G");
    tick(7);
    wait_ms(1001);
    assert(!fake.clock_runs && fake.levels == 0);
    wait_ms(10);
    assert(fake.out[0] == 100 && fake.out[1] == 100);
    assert(strncmp(ask("?"), "S off w ", 8) == 0);
}

static void requests_keep_the_watchdog_quiet(void)
{
    ask("ON");
    ask("V 1000 100");
    expect("W 50", "S on - 1000 100 1001 101 0 0\n");
    for (unsigned i = 0; i < 10; i++) {
        wait_ms(50);
        ask("?");
    }
    assert(fake.out[0] == 1000);
    for (unsigned i = 0; i < 3; i++) {
        wait_ms(20);
        ask("garbage*0000"); /* noise is no host */
    }
    assert(fake.out[0] < 1000);
}

static void a_watchdog_of_0_never_trips(void)
{
    ask("ON");
    ask("V 1000 100");
    ask("W 0");
    wait_ms(70000);
    assert(fake.out[0] == 1000);
}

static void off_goes_to_the_safe_value(void)
{
    ask("ON");
    ask("V 1000 100");
    ask("OFF");
    wait_ms(4);
    expect("?", "S off - 100 100 101 101 0 0\n");
}

static void lost_bytes_are_told_once(void)
{
    player_overrun();
    assert(strncmp(ask("?"), "S off ro ", 9) == 0);
    assert(strncmp(ask("?"), "S off r ", 8) == 0);
}

static void a_name_is_kept(void)
{
    expect("N lab-7", "S off r 100 100 101 101 0 0\n");
    assert(strstr(ask("I"), " name=lab-7 "));
    expect("N longer-than-8", "E syntax\n");
    expect("N", "E syntax\n");
}

static void any_bytes_leave_a_board_that_answers(void)
{
    srand(1);
    for (unsigned i = 0; i < 200000; i++) {
        /* Mostly the letters of requests, so that many lines nearly are one. */
        static const char letters[] = "VTPGRLAWION?@* 0123456789\n";
        player_byte((uint8_t)(rand() % 4 ? letters[rand() % (int)(sizeof letters - 1)] : rand()));
        fake.n_sent = 0;
        tick(1);
        if (i % 50 == 0)
            player_millisecond();
    }
    wait_ms(201);
    ask("");
    ask_checked("OFF");
    wait_ms(300);
    assert(strncmp(ask_checked("?"), "S off ", 6) == 0);
    assert(fake.out[0] == 100 && fake.out[1] == 100);
}

int main(void)
{
    static void (*const tests[])(void) = {
        crc_is_that_of_the_catalogue, outputs_are_safe_from_the_start, a_set_point_is_in_force_and_sampled,
        requests_that_make_no_sense_change_nothing, a_long_line_is_refused_as_a_whole,
        checksums_are_asked_for_once_they_were_seen, a_play_gives_each_row_in_order_and_records_beside,
        lines_pulse_where_they_are_asked_to,
        a_record_begins_where_it_is_asked_to, a_record_ends_where_the_memory_ends, a_play_keeps_set_points_out,
        a_late_point_is_told, an_edge_starts_or_steps,
        a_play_waits_for_edges_and_counts_those_that_come_too_early, an_edge_starts_the_first_row,
        edges_that_come_too_often_take_no_room_from_others, a_table_that_differs_is_not_played,
        a_plan_that_does_not_fit_is_refused, a_table_out_of_range_is_refused, half_a_table_is_given_up,
        a_flipped_bit_in_a_table_is_told, a_silent_host_ends_in_the_safe_value, a_silent_host_ends_a_play,
        requests_keep_the_watchdog_quiet, a_watchdog_of_0_never_trips, off_goes_to_the_safe_value,
        lost_bytes_are_told_once, a_name_is_kept, any_bytes_leave_a_board_that_answers,
    };
    for (unsigned i = 0; i < sizeof tests / sizeof tests[0]; i++) {
        int status;
        if (fork() == 0) { /* in a process of its own: the core begins as after a reset */
            player_start();
            tests[i]();
            exit(0);
        }
        if (wait(&status) < 0 || status)
            return 1;
    }
    printf("%u facts hold\n", (unsigned)(sizeof tests / sizeof tests[0]));
    return 0;
}
