/* A small position controller: moves a hydraulic cylinder to targets, one after the other.
 *
 * It stands for the firmware under test: real C, built for the host, that knows the devices by
 * their CANopen profiles only. Each cycle sends the valve's command and SYNC, takes what the
 * devices answer, and computes the next command from that.
 */
#include "position_control.h"

#include <getopt.h>
#include <signal.h>
#include <stdio.h>

static volatile sig_atomic_t has_signal;

static void interrupt(int number)
{
    (void)number;
    has_signal = 1;
}

static bool is_interrupted(void)
{
    return has_signal != 0;
}

static bool parse(int argc, char **argv, struct options *options)
{
    static const struct option names[] = {
        {"bus", required_argument, NULL, 'b'},       {"lockstep", no_argument, NULL, 'l'},
        {"period-us", required_argument, NULL, 's'}, {"speed-mm-s", required_argument, NULL, 's'},
        {"dwell-ms", required_argument, NULL, 's'},  {"targets-mm", required_argument, NULL, 's'},
        {NULL, 0, NULL, 0},
    };
    bool is_right = true;
    int option, index;

    while ((option = getopt_long(argc, argv, "", names, &index)) != -1) {
        switch (option) {
        case 'b': options->bus = optarg; break;
        case 'l': options->is_lockstep = true; break;
        case 's': is_right &= set_option(options, names[index].name, optarg); break;
        default: return false;
        }
    }
    return is_right && optind == argc && options->bus != NULL && options->target_count > 0;
}

int main(int argc, char **argv)
{
    struct options options = default_options();
    struct sigaction action = {.sa_handler = interrupt};
    struct report report = {0};
    bool has_begun = false;

    if (!parse(argc, argv, &options)) {
        fprintf(stderr, "usage: %s --bus vcan0|HOST:PORT [--lockstep] [--period-us US] "
                        "[--speed-mm-s V] [--dwell-ms MS] --targets-mm X,X,...\n", argv[0]);
        return USAGE;
    }
    setvbuf(stdout, NULL, _IOLBF, 0);
    sigaction(SIGINT, &action, NULL); /* without SA_RESTART: a signal ends a wait */
    sigaction(SIGTERM, &action, NULL);
    return (int)position_control(&options, &report, is_interrupted, &has_begun);
}
