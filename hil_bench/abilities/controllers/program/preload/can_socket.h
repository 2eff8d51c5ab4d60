/* A CAN_RAW socket: the program's end of a pair, whose other end this library fills. */
#ifndef HIL_BENCH_CAN_SOCKET_H
#define HIL_BENCH_CAN_SOCKET_H

#include "bench.h"

#include <linux/can.h>
#include <linux/can/raw.h>

#define MOST_FILTERS CAN_RAW_FILTER_MAX

enum stamps { NO_STAMPS, MICROSECONDS, NANOSECONDS };

struct can_socket {
    int descriptors; /* that are open on it */
    int peer;        /* the other end of the pair */
    int index;       /* of the interface; 0 for all, -1 where it is not bound */
    struct can_filter filters[MOST_FILTERS];
    unsigned int filter_count;
    can_err_mask_t errors;
    int is_looped, receives_own, joins_filters, takes_fd; /* as options give them */
    int counts_drops, is_detailed; /* SO_RXQ_OVFL, SO_TIMESTAMPING */
    enum stamps stamps;
    uint32_t dropped;
    int64_t patience;   /* of a read (SO_RCVTIMEO), which the kernel rounds to its jiffies [ns] */
    int64_t last_stamp; /* of the frame read last; -1 for none */
};

/* A packet in the pair: a read of 16 bytes that passes this library by gets the frame. */
struct packet {
    struct can_frame frame;
    int64_t time;
    int32_t index;
    uint32_t dropped;
    uint32_t flags; /* MSG_DONTROUTE: of this program, MSG_CONFIRM: of this socket */
};

/* The socket at a descriptor; NULL for anything else. */
struct can_socket *can_at(int fd);

#endif
