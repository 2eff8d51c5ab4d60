#include "position_control.h"
#include "platform.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define POSITION_GAIN 20.0 /* [1/s] */
#define FULL_SPEED 0.29    /* of the piston at full opening [m/s] */
#define DEAD_ZONE (0.3 / 1.3)
#define TOLERANCE 50e-6 /* [m]; an error that is left alone at rest */
#define SETTLED 100e-6  /* [m] */
#define PATIENCE 1.0    /* for settling at a target [s] */

/* The opening that gives the wanted speed: feed-forward, gain on the error, dead-zone. */
static double opening(double setpoint, double speed, double position)
{
    double error = setpoint - position, wanted = speed + POSITION_GAIN * error;
    double share = fmin(fabs(wanted) / FULL_SPEED, 1.0);

    if (speed == 0.0 && fabs(error) <= TOLERANCE)
        return 0.0;
    return copysign(DEAD_ZONE + (1.0 - DEAD_ZONE) * share, wanted);
}

/* Moves the set-point towards a target by at most one cycle's way; returns its speed [m/s]. */
static double approach(double *setpoint, double target, double speed, double period)
{
    double way = target - *setpoint, step = speed * period;

    if (fabs(way) <= step) {
        *setpoint = target;
        return 0.0;
    }
    *setpoint += copysign(step, way);
    return copysign(speed, way);
}

/* Waits for the next cycle on the grid; returns its end. A cycle that is over is left out. */
static int64_t next_deadline(struct canopen *master, int64_t deadline_us, struct report *report)
{
    canopen_listen(master, deadline_us);
    deadline_us += master->period_us;
    while (!master->is_lockstep && deadline_us <= canopen_now_us(master)) {
        deadline_us += master->period_us;
        report->overruns++;
    }
    return deadline_us;
}

static enum outcome control(struct axis *axis, const struct options *options,
                            struct report *report, bool (*is_interrupted)(void))
{
    const double period = (double)options->period_us * 1e-6;
    struct feedback *now = &report->last;
    int64_t deadline_us = canopen_now_us(axis->master) + options->period_us;
    double setpoint = 0.0, speed = 0.0, rest = 0.0, settling = 0.0, command = 0.0;
    int target = 0;

    while (target < options->target_count) {
        enum outcome outcome = axis_cycle(axis, 7, command, deadline_us, now);
        if (outcome != DONE)
            return outcome;
        if (is_interrupted())
            return INTERRUPTED;
        report->cycles++;
        if (!now->is_active || report->cycles == 1) {
            setpoint = now->position; /* begin from where the piston is */
            command = 0.0;
        } else {
            report->largest_error = fmax(report->largest_error, fabs(setpoint - now->position));
            speed = approach(&setpoint, options->targets[target], options->speed, period);
            settling = speed == 0.0 ? settling + period : 0.0;
            rest = settling > 0.0 && fabs(setpoint - now->position) <= SETTLED ? rest + period : 0.0;
            command = opening(setpoint, speed, now->position);
        }
        if (rest >= options->dwell) {
            platform_tell("%.3f s: %.3f mm at target %.3f mm\n", (double)report->cycles * period,
                   now->position * 1e3, options->targets[target] * 1e3);
            settling = rest = 0.0;
            target++;
        }
        if (settling > PATIENCE + options->dwell) {
            platform_warn("firmware: does not settle: %.3f mm from the target\n",
                    (setpoint - now->position) * 1e3);
            return DEVICE_FAILED;
        }
        deadline_us = next_deadline(axis->master, deadline_us, report);
    }
    return DONE;
}

/* Reads a positive number times a unit. */
static bool read_positive(const char *text, double unit, double *value)
{
    char *end;

    *value = strtod(text, &end) * unit;
    return *text != '\0' && *end == '\0' && *value > 0.0 && *value <= 1e9;
}

/* Reads "50,-20": targets in mm. */
static bool read_targets(const char *text, struct options *options)
{
    char *end = NULL;

    for (options->target_count = 0; options->target_count < MOST_TARGETS; text = end + 1) {
        double target = strtod(text, &end) * 1e-3;
        if (end == text || !isfinite(target))
            return false;
        options->targets[options->target_count++] = target;
        if (*end != ',')
            return *end == '\0';
    }
    return false;
}

struct options default_options(void)
{
    return (struct options){.period_us = DEFAULT_PERIOD_US, .speed = 0.15, .dwell = 0.2};
}

bool set_option(struct options *options, const char *name, const char *text)
{
    double period_us;

    if (strcmp(name, "targets-mm") == 0)
        return read_targets(text, options);
    if (strcmp(name, "speed-mm-s") == 0)
        return read_positive(text, 1e-3, &options->speed);
    if (strcmp(name, "dwell-ms") == 0)
        return read_positive(text, 1e-3, &options->dwell);
    if (strcmp(name, "period-us") != 0 || !read_positive(text, 1.0, &period_us))
        return false;
    options->period_us = llround(period_us);
    return options->period_us > 0;
}

static void print_report(const struct report *report)
{
    platform_tell("%lld cycles, %lld overruns, largest error %.3f mm, position %.3f mm, "
           "P_A %.1f bar, P_B %.1f bar\n",
           (long long)report->cycles, (long long)report->overruns, report->largest_error * 1e3,
           report->last.position * 1e3, report->last.pressures[0], report->last.pressures[1]);
}

enum outcome position_control(const struct options *options, struct report *report,
                              bool (*is_interrupted)(void), bool *has_begun)
{
    struct canopen master = {
        .node_id = 127,
        .is_lockstep = options->is_lockstep,
        .period_us = options->period_us,
        .devices = {{.name = "valve", .node_id = 1, .profile = 408, .pdo_length = 4},
                    {.name = "pressure A", .node_id = 2, .profile = 404, .pdo_length = 5},
                    {.name = "pressure B", .node_id = 3, .profile = 404, .pdo_length = 5},
                    {.name = "position", .node_id = 4, .profile = 406, .pdo_length = 4}},
    };
    struct axis axis;
    enum outcome outcome;

    if (!can_bus_open(&master.bus, options->bus))
        return BUS_LOST;
    outcome = axis_start(&axis, &master);
    if (outcome == DONE) {
        *has_begun = true;
        outcome = control(&axis, options, report, is_interrupted);
        axis_stop(&axis);
        print_report(report);
    }
    if (master.is_lost)
        platform_warn("firmware: bus %s: lost\n", options->bus);
    can_bus_close(&master.bus);
    return outcome;
}
