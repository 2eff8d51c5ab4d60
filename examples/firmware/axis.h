/* One hydraulic axis on CANopen: a valve (CiA 408), two pressure transducers (CiA 404) and a
 * position sensor (CiA 406).
 */
#ifndef AXIS_H
#define AXIS_H

#include "canopen.h"

enum { VALVE, PRESSURE_A, PRESSURE_B, POSITION }; /* places in canopen.devices */

struct feedback {
    double position;  /* [m] */
    double pressures[2]; /* [bar] */
    double spool;     /* fraction of full opening */
    bool is_active;   /* whether the valve follows the set-point */
};

struct axis {
    struct canopen *master;
    double position_step; /* [m] */
    double full_scale;    /* what stands for full opening */
    int misses;           /* cycles in a row without an answer of every device */
};

/* Resets and configures the devices and brings them to OPERATIONAL. */
enum outcome axis_start(struct axis *axis, struct canopen *master);

/* One cycle: the command (control word 7 is active, 3 hold, 1 disabled; a set-point in fractions
 * of full opening), SYNC, and the answers to it. */
enum outcome axis_cycle(struct axis *axis, uint16_t control_word, double setpoint,
                        int64_t deadline_us, struct feedback *feedback);

/* Leaves the valve disabled, the devices PRE-OPERATIONAL, and nobody watching us. */
void axis_stop(struct axis *axis);

#endif
