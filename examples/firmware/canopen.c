#include "canopen.h"
#include "platform.h"

#include <inttypes.h>
#include <string.h>

#define HEARTBEAT_PERIOD_US 50000
#define SDO_TIMEOUT_US 500000
#define BOOT_UP 0x00
#define OPERATIONAL 0x05

enum { NMT = 0x000, SYNC = 0x080, EMCY = 0x080, TPDO1 = 0x180, SDO_ANSWER = 0x580,
       SDO_REQUEST = 0x600, HEARTBEAT = 0x700 };

int64_t canopen_now_us(const struct canopen *master)
{
    return master->is_lockstep ? master->syncs * master->period_us : platform_now_us();
}

static struct device *find_device(struct canopen *master, uint16_t node_id)
{
    for (int i = 0; i < DEVICES; i++)
        if (master->devices[i].node_id == node_id)
            return &master->devices[i];
    return NULL;
}

static void take(struct canopen *master, const struct frame *frame)
{
    struct device *device = find_device(master, frame->id & 0x7F);

    if (device == NULL)
        return;
    switch (frame->id & ~0x7F) {
    case TPDO1:
        if (frame->length >= device->pdo_length) {
            device->pdo = *frame;
            device->has_answered = true;
        }
        break;
    case SDO_ANSWER:
        master->sdo_answer = *frame;
        master->has_sdo_answer = frame->length == 8;
        break;
    case HEARTBEAT:
        device->has_booted |= frame->data[0] == BOOT_UP;
        device->is_operational = frame->data[0] == OPERATIONAL;
        device->was_operational |= device->is_operational;
        device->silence = 0;
        break;
    case EMCY:
        device->emergency = (uint16_t)(frame->data[0] | frame->data[1] << 8);
        break;
    default:
        break;
    }
}

bool canopen_wait(struct canopen *master, condition is_done, int64_t deadline_us)
{
    int64_t guard_us = master->is_lockstep ? platform_now_us() + LOCKSTEP_PATIENCE_US : deadline_us;
    struct frame frame;

    while (!is_done(master)) {
        int64_t left_us = guard_us - platform_now_us();
        enum receive_result result = can_bus_receive(&master->bus, &frame, left_us);
        master->is_lost |= result == RECEIVE_LOST;
        if (master->is_lost || (result == RECEIVE_NOTHING && left_us <= 0))
            return false;
        if (result == RECEIVE_FRAME)
            take(master, &frame);
    }
    return true;
}

static bool never(const struct canopen *master)
{
    (void)master;
    return false;
}

void canopen_listen(struct canopen *master, int64_t until_us)
{
    if (!master->is_lockstep)
        canopen_wait(master, never, until_us);
}

bool canopen_send(struct canopen *master, uint16_t id, const void *data, uint8_t length)
{
    struct frame frame = {.id = id, .length = length};

    memcpy(frame.data, data, length);
    master->is_lost |= !can_bus_send(&master->bus, &frame);
    return !master->is_lost;
}

bool canopen_nmt(struct canopen *master, enum nmt_command command)
{
    const uint8_t data[] = {(uint8_t)command, 0};

    return canopen_send(master, NMT, data, sizeof data) && can_bus_flush(&master->bus);
}

static bool send_heartbeat(struct canopen *master)
{
    const uint8_t state = OPERATIONAL;
    int64_t now_us = canopen_now_us(master);

    if (now_us < master->next_heartbeat_us)
        return true;
    master->next_heartbeat_us = now_us + HEARTBEAT_PERIOD_US;
    return canopen_send(master, HEARTBEAT + master->node_id, &state, 1);
}

static bool has_sdo_answer(const struct canopen *master)
{
    return master->has_sdo_answer;
}

static bool all_answered(const struct canopen *master)
{
    for (int i = 0; i < DEVICES; i++)
        if (!master->devices[i].has_answered)
            return false;
    return true;
}

void canopen_sync(struct canopen *master, int64_t deadline_us)
{
    const uint8_t request[8] = {0x40, 0x00, 0x10, 0x00}; /* of 0x1000, the device type */

    for (int i = 0; i < DEVICES; i++) {
        master->devices[i].has_answered = false;
        master->devices[i].silence++;
    }
    send_heartbeat(master);
    canopen_send(master, SYNC, "", 0);
    master->syncs++;
    master->has_sdo_answer = false;
    if (master->is_lockstep)
        canopen_send(master, SDO_REQUEST + master->devices[master->fence].node_id, request, 8);
    master->is_lost |= !can_bus_flush(&master->bus);
    if (!master->is_lockstep)
        canopen_wait(master, all_answered, deadline_us);
    else if (!canopen_wait(master, has_sdo_answer, deadline_us))
        master->fence = (master->fence + 1) % DEVICES; /* it is silent: ask another one */
}

/* Sends a request and waits for the answer, an abort included. */
static bool exchange(struct canopen *master, const struct device *device, const uint8_t request[8])
{
    master->has_sdo_answer = false;
    if (!canopen_send(master, SDO_REQUEST + device->node_id, request, 8))
        return false;
    if (!can_bus_flush(&master->bus))
        return false;
    if (!canopen_wait(master, has_sdo_answer, canopen_now_us(master) + SDO_TIMEOUT_US))
        return false;
    return master->sdo_answer.id == SDO_ANSWER + device->node_id;
}

static bool refuse(const struct canopen *master, const struct device *device,
                   const uint8_t request[8])
{
    uint32_t code = 0;

    if (master->has_sdo_answer && master->sdo_answer.data[0] == 0x80)
        for (int i = 0; i < 4; i++)
            code |= (uint32_t)master->sdo_answer.data[4 + i] << 8 * i;
    platform_warn("firmware: %s (node %u): object 0x%02X%02X.%02X: ", device->name,
            device->node_id, request[2], request[1], request[3]);
    if (code)
        platform_warn("SDO abort 0x%08" PRIX32 "\n", code);
    else
        platform_warn("no answer that fits\n");
    return false;
}

bool canopen_write(struct canopen *master, const struct device *device, uint16_t index,
                   uint8_t subindex, uint32_t value, uint8_t size)
{
    uint8_t request[8] = {(uint8_t)(0x23 | (4 - size) << 2), (uint8_t)index,
                          (uint8_t)(index >> 8), subindex};

    for (int i = 0; i < size; i++)
        request[4 + i] = (uint8_t)(value >> 8 * i);
    if (!exchange(master, device, request) || master->sdo_answer.data[0] != 0x60)
        return refuse(master, device, request);
    return true;
}

bool canopen_read(struct canopen *master, const struct device *device, uint16_t index,
                  uint8_t subindex, uint32_t *value)
{
    const uint8_t request[8] = {0x40, (uint8_t)index, (uint8_t)(index >> 8), subindex};
    const uint8_t *answer = master->sdo_answer.data;

    /* 0x43 to 0x4F: expedited, with its size */
    if (!exchange(master, device, request) || (answer[0] & 0xF3) != 0x43)
        return refuse(master, device, request);
    *value = 0;
    for (int i = 0; i < 4 - (answer[0] >> 2 & 3); i++)
        *value |= (uint32_t)answer[4 + i] << 8 * i;
    return true;
}
