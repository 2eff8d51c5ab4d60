#include "can_socket.h"
#include "netlink.h"

#include <fcntl.h>
#include <linux/netlink.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define PEERS 512 /* the lowest descriptor of a pair's other end, out of the program's way */

static struct can_socket *sockets[MOST_DESCRIPTORS];

struct can_socket *can_at(int fd)
{
    return fd >= 0 && fd < MOST_DESCRIPTORS ? sockets[fd] : NULL;
}

bool is_can(int fd)
{
    return can_at(fd) != NULL;
}

void forget_can(int fd)
{
    struct can_socket *can = can_at(fd);

    if (can == NULL)
        return;
    lock();
    sockets[fd] = NULL;
    if (--can->descriptors == 0) {
        REAL(close)(can->peer);
        free(can);
    }
    unlock();
}

void copy_can(int from, int to)
{
    forget_can(to);
    if (can_at(from) == NULL || to < 0 || to >= MOST_DESCRIPTORS)
        return;
    lock();
    sockets[to] = sockets[from];
    sockets[to]->descriptors++;
    unlock();
}

static int set_errno(int number)
{
    errno = number;
    return -1;
}

int open_pair(int flags, int ends[2])
{
    int high;

    if (REAL(socketpair)(AF_UNIX, SOCK_SEQPACKET | flags, 0, ends) < 0)
        return -1;
    if (ends[0] >= MOST_DESCRIPTORS) {
        REAL(close)(ends[0]);
        REAL(close)(ends[1]);
        return set_errno(EMFILE);
    }
    high = REAL(fcntl)(ends[1], F_DUPFD_CLOEXEC, PEERS);
    if (high >= 0) {
        REAL(close)(ends[1]);
        ends[1] = high;
    }
    return 0;
}

static int open_can(int flags)
{
    struct can_socket *can = calloc(1, sizeof *can);
    int ends[2];

    if (can == NULL)
        return set_errno(ENOMEM);
    if (exchange->is_real && !start_pump()) {
        free(can);
        return -1;
    }
    if (open_pair(flags, ends) < 0) {
        free(can);
        return -1;
    }
    can->peer = ends[1];
    can->descriptors = 1;
    can->index = -1;
    can->filter_count = 1; /* of all zeros, which every frame passes */
    can->is_looped = 1;
    can->patience = NEVER;
    can->last_stamp = -1;
    lock();
    sockets[ends[0]] = can;
    unlock();
    return ends[0];
}

EXPORT int socket(int domain, int type, int protocol)
{
    const int flags = type & (SOCK_CLOEXEC | SOCK_NONBLOCK);

    if (on_bench() && domain == AF_NETLINK && protocol == NETLINK_ROUTE)
        return open_link(flags);
    if (!on_bench() || domain != PF_CAN)
        return REAL(socket)(domain, type, protocol);
    if ((type & ~flags) == SOCK_RAW && protocol == CAN_RAW)
        return open_can(flags);
    fprintf(stderr, "hil-bench: CAN protocol %d is not supported; CAN_RAW is\n", protocol);
    return set_errno(EPROTONOSUPPORT);
}

EXPORT int bind(int fd, const struct sockaddr *address, socklen_t length)
{
    const struct sockaddr_can *wanted = (const void *)address;
    struct can_socket *can = can_at(fd);

    if (is_link(fd))
        return 0;
    if (can == NULL)
        return REAL(bind)(fd, address, length);
    if (length < offsetof(struct sockaddr_can, can_addr) || address->sa_family != AF_CAN)
        return set_errno(EINVAL);
    if (wanted->can_ifindex != 0 && bus_of_index(wanted->can_ifindex) < 0)
        return set_errno(ENODEV);
    can->index = wanted->can_ifindex;
    return 0;
}

EXPORT int getsockname(int fd, struct sockaddr *restrict address, socklen_t *restrict length)
{
    struct can_socket *can = can_at(fd);
    struct sockaddr_can own = {.can_family = AF_CAN};

    if (is_link(fd)) {
        name_link(true, address, length);
        return 0;
    }
    if (can == NULL)
        return REAL(getsockname)(fd, address, length);
    own.can_ifindex = can->index < 0 ? 0 : can->index;
    memcpy(address, &own, *length < sizeof own ? *length : sizeof own);
    *length = sizeof own;
    return 0;
}

EXPORT int connect(int fd, const struct sockaddr *address, socklen_t length)
{
    return is_can(fd) ? set_errno(EOPNOTSUPP) : REAL(connect)(fd, address, length);
}

static int set_filters(struct can_socket *can, const void *value, socklen_t length)
{
    if (length % sizeof *can->filters != 0 || length > sizeof can->filters)
        return set_errno(EINVAL);
    lock();
    if (length > 0)
        memcpy(can->filters, value, length);
    can->filter_count = length / sizeof *can->filters;
    unlock();
    return 0;
}

int64_t patience_of(int fd)
{
    return sockets[fd]->patience;
}

static void set_patience(struct can_socket *can, const void *value, socklen_t length)
{
    struct timeval limit;

    if (length < sizeof limit)
        return; /* which the kernel refuses */
    memcpy(&limit, value, sizeof limit);
    can->patience = limit.tv_sec * SECOND + limit.tv_usec * 1000;
    if (can->patience == 0)
        can->patience = NEVER;
}

/* The field of an option that is one number; NULL where it is none. */
static int *option_field(struct can_socket *can, int level, int name)
{
    if (level == SOL_SOCKET)
        return name == SO_RXQ_OVFL     ? &can->counts_drops
               : name == SO_TIMESTAMPING ? &can->is_detailed
                                         : NULL;
    switch (name) {
    case CAN_RAW_LOOPBACK:
        return &can->is_looped;
    case CAN_RAW_RECV_OWN_MSGS:
        return &can->receives_own;
    case CAN_RAW_FD_FRAMES:
        return &can->takes_fd;
    case CAN_RAW_JOIN_FILTERS:
        return &can->joins_filters;
    case CAN_RAW_ERR_FILTER:
        return (int *)&can->errors;
    default:
        return NULL;
    }
}

EXPORT int setsockopt(int fd, int level, int name, const void *value, socklen_t length)
{
    struct can_socket *can = can_at(fd);
    int *field;

    if (is_link(fd) && level == SOL_NETLINK)
        return 0;
    if (can == NULL)
        return REAL(setsockopt)(fd, level, name, value, length);
    if (level == SOL_CAN_RAW && name == CAN_RAW_FILTER)
        return set_filters(can, value, length);
    field = level == SOL_SOCKET || level == SOL_CAN_RAW ? option_field(can, level, name) : NULL;
    if (field != NULL || (level == SOL_SOCKET && (name == SO_TIMESTAMP || name == SO_TIMESTAMPNS))) {
        int number;

        if (length < sizeof number)
            return set_errno(EINVAL);
        memcpy(&number, value, sizeof number);
        if (field != NULL)
            *field = number;
        else
            can->stamps = !number ? NO_STAMPS : name == SO_TIMESTAMP ? MICROSECONDS : NANOSECONDS;
        return 0;
    }
    if (level != SOL_SOCKET)
        return set_errno(ENOPROTOOPT);
    if (name == SO_RCVTIMEO)
        set_patience(can, value, length);
    return REAL(setsockopt)(fd, level, name, value, length);
}

/* Returns the value of an option, as getsockopt() does. */
static int give(const void *value, socklen_t size, void *place, socklen_t *length)
{
    if (*length > size)
        *length = size;
    memcpy(place, value, *length);
    return 0;
}

EXPORT int getsockopt(int fd, int level, int name, void *restrict value, socklen_t *restrict length)
{
    struct can_socket *can = can_at(fd);
    const int domain = AF_CAN, type = SOCK_RAW, protocol = CAN_RAW;
    int *field;

    if (can == NULL)
        return REAL(getsockopt)(fd, level, name, value, length);
    if (level == SOL_CAN_RAW && name == CAN_RAW_FILTER)
        return give(can->filters, can->filter_count * sizeof *can->filters, value, length);
    if (level == SOL_SOCKET && name == SO_DOMAIN)
        return give(&domain, sizeof domain, value, length);
    if (level == SOL_SOCKET && name == SO_TYPE)
        return give(&type, sizeof type, value, length);
    if (level == SOL_SOCKET && name == SO_PROTOCOL)
        return give(&protocol, sizeof protocol, value, length);
    field = level == SOL_SOCKET || level == SOL_CAN_RAW ? option_field(can, level, name) : NULL;
    if (field != NULL)
        return give(field, sizeof *field, value, length);
    if (level != SOL_SOCKET)
        return set_errno(ENOPROTOOPT);
    return REAL(getsockopt)(fd, level, name, value, length);
}

/* As can_rx_register() and can_rcv_filter() of the kernel. */
static bool passes(const struct can_filter *filter, canid_t id)
{
    canid_t mask = filter->can_mask & ~(canid_t)CAN_ERR_FLAG;
    const canid_t wanted = filter->can_id & ~(canid_t)CAN_INV_FILTER;

    if ((mask & CAN_EFF_FLAG) && !(wanted & CAN_EFF_FLAG))
        mask &= CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    return ((id & mask) == (wanted & mask)) != ((filter->can_id & CAN_INV_FILTER) != 0);
}

static bool is_wanted(const struct can_socket *can, canid_t id)
{
    unsigned int passed = 0;

    if (id & CAN_ERR_FLAG)
        return (id & can->errors) != 0;
    for (unsigned int i = 0; i < can->filter_count; i++)
        passed += passes(&can->filters[i], id);
    return can->joins_filters ? passed == can->filter_count && passed : passed > 0;
}

/* Puts a packet into each socket that listens to its interface. */
static void distribute(struct packet *packet, const struct can_socket *sender)
{
    const uint32_t flags = packet->flags;

    for (int fd = 0; fd < MOST_DESCRIPTORS; fd++) {
        struct can_socket *can = sockets[fd];

        if (can == NULL || can->index < 0 || (can->index != 0 && can->index != packet->index))
            continue;
        if ((can == sender && !can->receives_own) || !is_wanted(can, packet->frame.can_id))
            continue;
        if (fd > 0 && can->descriptors > 1) { /* the first descriptor stands for all */
            int first = 0;

            while (sockets[first] != can)
                first++;
            if (first != fd)
                continue;
        }
        packet->dropped = can->dropped;
        packet->flags = flags | (can == sender ? MSG_CONFIRM : 0);
        if (REAL(send)(can->peer, packet, sizeof *packet, MSG_DONTWAIT | MSG_NOSIGNAL) < 0)
            can->dropped++; /* its queue is full */
    }
}

void deliver(const struct record *record)
{
    struct packet packet = {
        .frame = {.can_id = record->id, .can_dlc = record->length},
        .time = exchange->is_real ? present() : record->time,
        .index = FIRST_INDEX + record->bus,
    };

    memcpy(packet.frame.data, record->data, sizeof packet.frame.data);
    distribute(&packet, NULL);
}

static ssize_t send_can(const struct can_socket *can, int index, const void *data, size_t size)
{
    struct packet packet = {.time = present(), .flags = MSG_DONTROUTE};
    struct record record = {.time = packet.time};
    const int bus = bus_of_index(index);
    bool is_sent;

    if (bus < 0)
        return set_errno(ENXIO);
    if (size != CAN_MTU) /* a bus of the bench takes no CAN FD */
        return set_errno(EINVAL);
    memcpy(&packet.frame, data, size);
    if (packet.frame.can_dlc > CAN_MAX_DLEN)
        return set_errno(EINVAL);
    count_call();
    packet.index = index;
    record.id = packet.frame.can_id;
    record.length = packet.frame.can_dlc;
    record.bus = (uint8_t)bus;
    memcpy(record.data, packet.frame.data, sizeof record.data);
    lock();
    is_sent = (record.id & CAN_ERR_FLAG) || send_record(&record); /* no error frame is on a bus */
    if (is_sent && can->is_looped)
        distribute(&packet, can);
    unlock();
    return is_sent ? (ssize_t)size : set_errno(ENOBUFS);
}

EXPORT ssize_t sendmsg(int fd, const struct msghdr *message, int flags)
{
    struct can_socket *can = can_at(fd);
    const struct sockaddr_can *address;
    unsigned char frame[CANFD_MTU];
    size_t size = 0;
    int index;

    if (is_link(fd))
        return ask_link(fd, message);
    if (can == NULL)
        return REAL(sendmsg)(fd, message, flags);
    address = message->msg_name;
    index = can->index;
    if (address != NULL) {
        if (message->msg_namelen < offsetof(struct sockaddr_can, can_addr) ||
            address->can_family != AF_CAN)
            return set_errno(EINVAL);
        index = address->can_ifindex;
    }
    for (size_t i = 0; i < message->msg_iovlen; i++) {
        const struct iovec *part = &message->msg_iov[i];

        if (part->iov_len > sizeof frame - size)
            return set_errno(EINVAL);
        memcpy(frame + size, part->iov_base, part->iov_len);
        size += part->iov_len;
    }
    return send_can(can, index, frame, size);
}

EXPORT int sendmmsg(int fd, struct mmsghdr *messages, unsigned int count, int flags)
{
    unsigned int sent = 0;

    if (!is_can(fd))
        return REAL(sendmmsg)(fd, messages, count, flags);
    for (; sent < count; sent++) {
        const ssize_t size = sendmsg(fd, &messages[sent].msg_hdr, flags);

        if (size < 0)
            return sent > 0 ? (int)sent : -1;
        messages[sent].msg_len = (unsigned int)size;
    }
    return (int)sent;
}

EXPORT ssize_t sendto(int fd, const void *data, size_t size, int flags,
                      const struct sockaddr *address, socklen_t length)
{
    struct iovec part = {.iov_base = (void *)(uintptr_t)data, .iov_len = size};
    struct msghdr message = {.msg_name = (void *)(uintptr_t)address, .msg_namelen = length,
                             .msg_iov = &part, .msg_iovlen = 1};

    if (!is_can(fd) && !is_link(fd))
        return REAL(sendto)(fd, data, size, flags, address, length);
    return sendmsg(fd, &message, flags);
}

EXPORT ssize_t send(int fd, const void *data, size_t size, int flags)
{
    if (!is_can(fd) && !is_link(fd))
        return REAL(send)(fd, data, size, flags);
    return sendto(fd, data, size, flags, NULL, 0);
}

EXPORT ssize_t write(int fd, const void *data, size_t size)
{
    return is_can(fd) ? sendto(fd, data, size, 0, NULL, 0) : REAL(write)(fd, data, size);
}

EXPORT ssize_t writev(int fd, const struct iovec *parts, int count)
{
    struct msghdr message = {.msg_iov = (struct iovec *)(uintptr_t)parts,
                             .msg_iovlen = (size_t)count};

    return is_can(fd) ? sendmsg(fd, &message, 0) : REAL(writev)(fd, parts, count);
}
