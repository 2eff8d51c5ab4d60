/* The position controller: its settings, and its run from boot-up to rest. */
#ifndef POSITION_CONTROL_H
#define POSITION_CONTROL_H

#include "axis.h"

#define MOST_TARGETS 16
#define DEFAULT_PERIOD_US 1000

struct options {
    const char *bus;
    bool is_lockstep;
    int64_t period_us;
    double speed; /* [m/s] */
    double dwell; /* at each target [s] */
    double targets[MOST_TARGETS]; /* [m] */
    int target_count;
};

struct report {
    int64_t cycles;
    int64_t overruns;
    double largest_error; /* [m] */
    struct feedback last;
};

/* Options as they are where nobody sets them; without targets. */
struct options default_options(void);

/* Sets "targets-mm", "speed-mm-s", "dwell-ms" or "period-us"; false where name or text is wrong. */
bool set_option(struct options *options, const char *name, const char *text);

/* Runs until all targets are reached, a device fails, the bus is lost or is_interrupted says so.
 * `has_begun` becomes true with the first cycle behind the start of the devices. */
enum outcome position_control(const struct options *options, struct report *report,
                              bool (*is_interrupted)(void), bool *has_begun);

#endif
