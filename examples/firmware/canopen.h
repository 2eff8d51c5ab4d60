/* The master's side of CANopen (CiA 301), as far as a small controller needs it: NMT, expedited
 * SDO, SYNC, its own heartbeat, and what its devices send: TPDO 1, heartbeat, emergency.
 *
 * Two kinds of time. In real time it is CLOCK_MONOTONIC. In lock-step it is the number of SYNCs
 * times their period, since it is SYNC that lets the time of the test bench pass. There, an SDO
 * request follows each SYNC: frames act in the order of the bus, so with its answer all has arrived
 * that the SYNC brought, also where a device is silent.
 */
#ifndef CANOPEN_H
#define CANOPEN_H

#include "can_bus.h"

#define DEVICES 4
#define LOCKSTEP_PATIENCE_US 5000000

enum nmt_command { NMT_START = 0x01, NMT_PRE_OPERATIONAL = 0x80, NMT_RESET_NODE = 0x81 };

/* Exit codes of the program; 0 is done. */
enum outcome { DONE = 0, DEVICE_FAILED = 1, USAGE = 2, BUS_LOST = 3, INTERRUPTED = 130 };

struct device {
    const char *name;
    uint8_t node_id;
    uint16_t profile;
    uint8_t pdo_length;   /* of its TPDO 1; a shorter one is passed over */
    bool has_booted;      /* whether it has since this was cleared */
    bool was_operational; /* by one of its heartbeats */
    bool is_operational;  /* by the last of them */
    int64_t silence;      /* cycles since that; the time of our own that we were held up is none */
    uint16_t emergency;   /* code of its last emergency, 0 for none */
    struct frame pdo;     /* its last TPDO 1 */
    bool has_answered;    /* whether that came since the last SYNC */
};

struct canopen {
    struct can_bus bus;
    struct device devices[DEVICES];
    uint8_t node_id; /* ours, in the heartbeat */
    bool is_lockstep;
    int64_t period_us;
    int64_t syncs;
    int64_t next_heartbeat_us;
    struct frame sdo_answer;
    bool has_sdo_answer;
    int fence; /* the device whose SDO answer ends a cycle in lock-step */
    bool is_lost; /* whether the bus is */
};

/* Time that has passed [us], see above. */
int64_t canopen_now_us(const struct canopen *master);

/* Takes frames until `is_done` says so; false when the deadline passed or the bus was lost. */
typedef bool (*condition)(const struct canopen *master);
bool canopen_wait(struct canopen *master, condition is_done, int64_t deadline_us);

/* Takes frames for so long [us]; in lock-step only what is there already. */
void canopen_listen(struct canopen *master, int64_t until_us);

bool canopen_send(struct canopen *master, uint16_t id, const void *data, uint8_t length);

/* Sends an NMT command to all devices. */
bool canopen_nmt(struct canopen *master, enum nmt_command command);

/* Sends SYNC, and our heartbeat where it is due, and takes the devices' answers until all are there
 * or the deadline has passed; in lock-step until all has arrived that will. */
void canopen_sync(struct canopen *master, int64_t deadline_us);

/* Writes or reads an object of a device; false with a line on standard error. */
bool canopen_write(struct canopen *master, const struct device *device, uint16_t index,
                   uint8_t subindex, uint32_t value, uint8_t size);
bool canopen_read(struct canopen *master, const struct device *device, uint16_t index,
                  uint8_t subindex, uint32_t *value);

#endif
