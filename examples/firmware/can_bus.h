/* A CAN bus: a SocketCAN interface, or a hub that speaks the socketcand protocol over TCP.
 *
 * The names of the two: "vcan0", and "127.0.0.1:29536" or "127.0.0.1:29536/can0".
 * 11-bit data frames only; others are passed over.
 */
#ifndef CAN_BUS_H
#define CAN_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct frame {
    uint16_t id;
    uint8_t length;
    uint8_t data[8];
};

struct can_bus {
    int fd;
    bool is_hub;
    char out[1024]; /* what the next flush sends to a hub */
    size_t out_length;
    char in[8192]; /* what a hub has sent and nobody has taken yet */
    size_t in_start;
    size_t in_end;
};

enum receive_result { RECEIVE_LOST = -1, RECEIVE_NOTHING = 0, RECEIVE_FRAME = 1 };

/* Opens the bus; false with a line on standard error where it cannot be opened. */
bool can_bus_open(struct can_bus *bus, const char *name);

/* Queues a frame; false when the bus is lost. */
bool can_bus_send(struct can_bus *bus, const struct frame *frame);

/* Sends what is queued; false when the bus is lost. */
bool can_bus_flush(struct can_bus *bus);

/* Takes the next frame, waiting for it at most so long [us]; a signal ends the wait early. */
enum receive_result can_bus_receive(struct can_bus *bus, struct frame *frame, int64_t timeout_us);

void can_bus_close(struct can_bus *bus);

#endif
