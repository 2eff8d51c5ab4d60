#include "axis.h"
#include "platform.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define BOOT_TIMEOUT_US 1000000
#define BOOT_TRIES 5
#define HEARTBEAT_MS 100
#define HEARTBEAT_TIMEOUT_MS 500
#define OUR_TIMEOUT_MS 1500 /* without our heartbeat or command: the valve goes to its safe state */
#define MOST_MISSES 10
#define STOP_CYCLES 20
#define RPDO1 0x200

enum { DISABLED = 1, HOLD = 3 }; /* control words of CiA 408 */

static enum outcome fail(const struct device *device, const char *what, unsigned number)
{
    char text[64];

    snprintf(text, sizeof text, what, number);
    platform_warn("firmware: %s (node %u): %s\n", device->name, device->node_id, text);
    return DEVICE_FAILED;
}

static bool all_booted(const struct canopen *master)
{
    for (int i = 0; i < DEVICES; i++)
        if (!master->devices[i].has_booted)
            return false;
    return true;
}

static enum outcome reset_devices(struct canopen *master)
{
    canopen_listen(master, canopen_now_us(master)); /* what booted before is none of the answer */
    for (int i = 0; i < DEVICES; i++)
        master->devices[i].has_booted = false;
    for (int number = 0; number < (master->is_lockstep ? 1 : BOOT_TRIES); number++) {
        if (!canopen_nmt(master, NMT_RESET_NODE))
            return BUS_LOST;
        if (canopen_wait(master, all_booted, canopen_now_us(master) + BOOT_TIMEOUT_US))
            return DONE;
    }
    for (int i = 0; i < DEVICES; i++)
        if (!master->devices[i].has_booted)
            return fail(&master->devices[i], "does not boot", 0);
    return DONE;
}

/* Has a device answer each SYNC with its TPDO 1, and tell its heartbeat. */
static bool configure(struct canopen *master, const struct device *device)
{
    uint32_t type;

    if (!canopen_read(master, device, 0x1000, 0, &type))
        return false;
    if ((type & 0xFFFF) != device->profile) {
        fail(device, "is of CiA profile %u", type & 0xFFFF);
        return false;
    }
    return canopen_write(master, device, 0x1800, 2, 1, 1) &&
           canopen_write(master, device, 0x1800, 5, 0, 2) &&
           canopen_write(master, device, 0x1017, 0, HEARTBEAT_MS, 2);
}

/* What the valve watches: our heartbeat and our commands. Zero switches it off. */
static bool watch_us(struct canopen *master, bool is_on)
{
    const struct device *valve = &master->devices[VALVE];
    uint32_t heartbeat = (uint32_t)master->node_id << 16 | OUR_TIMEOUT_MS;

    return canopen_write(master, valve, 0x1400, 5, is_on ? OUR_TIMEOUT_MS : 0, 2) &&
           canopen_write(master, valve, 0x1016, 1, is_on ? heartbeat : 0, 4);
}

static bool read_scaling(struct axis *axis, struct canopen *master)
{
    uint32_t step_nm, full_scale;

    if (!canopen_read(master, &master->devices[POSITION], 0x6005, 1, &step_nm) ||
        !canopen_read(master, &master->devices[VALVE], 0x6311, 1, &full_scale))
        return false;
    axis->position_step = step_nm * 1e-9;
    axis->full_scale = (int16_t)full_scale;
    return true;
}

enum outcome axis_start(struct axis *axis, struct canopen *master)
{
    enum outcome outcome = reset_devices(master);

    axis->master = master;
    axis->misses = 0;
    if (outcome != DONE)
        return outcome;
    for (int i = 0; i < DEVICES; i++)
        if (!configure(master, &master->devices[i]))
            return DEVICE_FAILED;
    if (!read_scaling(axis, master) || !watch_us(master, true))
        return DEVICE_FAILED;
    for (int i = 0; i < DEVICES; i++) {
        master->devices[i].emergency = 0;
        master->devices[i].has_booted = false;
        master->devices[i].was_operational = false;
        master->devices[i].silence = 0;
    }
    return canopen_nmt(master, NMT_START) ? DONE : BUS_LOST;
}

/* Whether a device has told of an error, has restarted, or is silent. */
static enum outcome check(const struct axis *axis, const struct device *device)
{
    if (device->emergency)
        return fail(device, "emergency 0x%04X", device->emergency);
    if (device->has_booted)
        return fail(device, "has restarted", 0);
    if (device->was_operational && !device->is_operational)
        return fail(device, "is no longer OPERATIONAL", 0);
    if (device->silence * axis->master->period_us > HEARTBEAT_TIMEOUT_MS * 1000)
        return fail(device, "no heartbeat for more than %u ms", HEARTBEAT_TIMEOUT_MS);
    if (axis->misses >= MOST_MISSES && !device->has_answered)
        return fail(device, "no answer to %u SYNCs", MOST_MISSES);
    return DONE;
}

static float read_float(const uint8_t *data)
{
    uint32_t bits = data[0] | data[1] << 8 | data[2] << 16 | (uint32_t)data[3] << 24;
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static void decode(const struct axis *axis, struct feedback *feedback)
{
    const struct device *devices = axis->master->devices;
    const uint8_t *valve = devices[VALVE].pdo.data, *position = devices[POSITION].pdo.data;
    uint32_t steps = position[0] | position[1] << 8 | position[2] << 16 |
                     (uint32_t)position[3] << 24;

    feedback->is_active = (valve[0] & 0x0F) == 0x0F;
    feedback->spool = (int16_t)(valve[2] | valve[3] << 8) / axis->full_scale;
    feedback->position = (int32_t)steps * axis->position_step;
    feedback->pressures[0] = read_float(devices[PRESSURE_A].pdo.data);
    feedback->pressures[1] = read_float(devices[PRESSURE_B].pdo.data);
}

/* Sends the command and SYNC and takes the answers. */
static void exchange(struct axis *axis, uint16_t control_word, double setpoint,
                     int64_t deadline_us)
{
    struct canopen *master = axis->master;
    int16_t steps = (int16_t)lround(setpoint * axis->full_scale);
    const uint8_t command[] = {(uint8_t)control_word, (uint8_t)(control_word >> 8),
                               (uint8_t)steps, (uint8_t)((uint16_t)steps >> 8)};

    canopen_send(master, RPDO1 + master->devices[VALVE].node_id, command, sizeof command);
    canopen_sync(master, deadline_us);
}

enum outcome axis_cycle(struct axis *axis, uint16_t control_word, double setpoint,
                        int64_t deadline_us, struct feedback *feedback)
{
    bool is_complete = true;

    exchange(axis, control_word, setpoint, deadline_us);
    if (axis->master->is_lost)
        return BUS_LOST;
    for (int i = 0; i < DEVICES; i++)
        is_complete &= axis->master->devices[i].has_answered;
    axis->misses = is_complete ? 0 : axis->misses + 1;
    decode(axis, feedback);
    for (int i = 0; i < DEVICES; i++) {
        enum outcome outcome = check(axis, &axis->master->devices[i]);
        if (outcome != DONE)
            return outcome;
    }
    return DONE;
}

void axis_stop(struct axis *axis)
{
    struct canopen *master = axis->master;
    uint32_t type;

    for (int i = 0; i < STOP_CYCLES && !master->is_lost; i++) {
        int64_t deadline_us = canopen_now_us(master) + master->period_us;
        exchange(axis, i < STOP_CYCLES / 2 ? HOLD : DISABLED, 0.0, deadline_us);
        canopen_listen(master, deadline_us);
    }
    if (master->is_lost || !watch_us(master, false) || !canopen_nmt(master, NMT_PRE_OPERATIONAL))
        return;
    canopen_read(master, &master->devices[VALVE], 0x1000, 0, &type); /* all has arrived */
}
