/* Reads: of CAN sockets, and of whatever else makes a program wait. */
#include "can_socket.h"
#include "netlink.h"

#include <fcntl.h>
#include <linux/errqueue.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <unistd.h>

int last_stamp(int fd, struct timespec *stamp)
{
    const struct can_socket *can = can_at(fd);

    if (can->last_stamp < 0) {
        errno = ENOENT;
        return -1;
    }
    *stamp = span_of(wall_time(can->last_stamp));
    return 0;
}

/* Adds a control message; MSG_CTRUNC where there is no room for it. */
static void add_control(struct msghdr *message, size_t *used, int type, const void *data,
                        size_t size)
{
    struct cmsghdr *control;

    if (*used + CMSG_SPACE(size) > message->msg_controllen) {
        message->msg_flags |= MSG_CTRUNC;
        return;
    }
    control = (struct cmsghdr *)((char *)message->msg_control + *used);
    control->cmsg_level = SOL_SOCKET;
    control->cmsg_type = type;
    control->cmsg_len = CMSG_LEN(size);
    memcpy(CMSG_DATA(control), data, size);
    *used += CMSG_SPACE(size);
}

static void fill_control(const struct can_socket *can, const struct packet *packet,
                         struct msghdr *message)
{
    const struct timespec stamp = span_of(wall_time(packet->time));
    const struct timeval rough = {stamp.tv_sec, stamp.tv_nsec / 1000};
    const struct scm_timestamping detailed = {.ts = {{stamp.tv_sec, stamp.tv_nsec}}};
    size_t used = 0;

    if (can->stamps == MICROSECONDS)
        add_control(message, &used, SO_TIMESTAMP, &rough, sizeof rough);
    if (can->stamps == NANOSECONDS)
        add_control(message, &used, SO_TIMESTAMPNS, &stamp, sizeof stamp);
    if (can->is_detailed)
        add_control(message, &used, SO_TIMESTAMPING, &detailed, sizeof detailed);
    if (can->counts_drops && packet->dropped)
        add_control(message, &used, SO_RXQ_OVFL, &packet->dropped, sizeof packet->dropped);
    message->msg_controllen = used;
}

/* Gives a packet to the program; returns the bytes that it gets. */
static ssize_t hand_out(struct can_socket *can, const struct packet *packet,
                        struct msghdr *message, int flags)
{
    const char *from = (const char *)&packet->frame;
    size_t left = CAN_MTU;

    message->msg_flags = (int)packet->flags;
    for (size_t i = 0; i < message->msg_iovlen && left > 0; i++) {
        const struct iovec *part = &message->msg_iov[i];
        const size_t size = part->iov_len < left ? part->iov_len : left;

        memcpy(part->iov_base, from, size);
        from += size;
        left -= size;
    }
    if (left > 0)
        message->msg_flags |= MSG_TRUNC;
    if (message->msg_name != NULL) {
        struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = packet->index};

        memcpy(message->msg_name, &address,
               message->msg_namelen < sizeof address ? message->msg_namelen : sizeof address);
        message->msg_namelen = sizeof address;
    }
    fill_control(can, packet, message);
    if (!(flags & MSG_PEEK))
        can->last_stamp = packet->time;
    return (ssize_t)(flags & MSG_TRUNC ? CAN_MTU : CAN_MTU - left);
}

EXPORT ssize_t recvmsg(int fd, struct msghdr *message, int flags)
{
    struct can_socket *can = can_at(fd);
    struct packet packet;
    const int way = (flags & (MSG_PEEK | MSG_DONTWAIT)) | (on_bench_time() ? MSG_DONTWAIT : 0);

    if (can == NULL) {
        socklen_t room = message->msg_namelen;
        const ssize_t got = wait_readable(fd, flags) < 0 ? -1 : REAL(recvmsg)(fd, message, flags);

        if (got >= 0 && is_link(fd)) {
            name_link(false, message->msg_name, &room);
            message->msg_namelen = room;
        }
        return got;
    }
    while (REAL(recv)(fd, &packet, sizeof packet, way) < 0)
        if (!on_bench_time() || errno != EAGAIN || wait_readable(fd, flags) < 0)
            return -1;
    return hand_out(can, &packet, message, flags);
}

/* As the kernel: with a time limit that is looked at between two messages only. */
EXPORT int recvmmsg(int fd, struct mmsghdr *messages, unsigned int count, int flags,
                    struct timespec *timeout)
{
    const int64_t deadline = on_bench_time() && timeout != NULL ? deadline_in(time_of(timeout)) : NEVER;
    unsigned int read = 0;

    if (!is_can(fd))
        return REAL(recvmmsg)(fd, messages, count, flags, timeout);
    for (; read < count && (read == 0 || exchange->now < deadline); read++) {
        const int now_flags = read > 0 && (flags & MSG_WAITFORONE) ? flags | MSG_DONTWAIT : flags;
        const ssize_t size = recvmsg(fd, &messages[read].msg_hdr, now_flags & ~MSG_WAITFORONE);

        if (size < 0)
            return read > 0 ? (int)read : -1;
        messages[read].msg_len = (unsigned int)size;
    }
    return (int)read;
}

EXPORT ssize_t recvfrom(int fd, void *restrict buffer, size_t size, int flags,
                        struct sockaddr *restrict address, socklen_t *restrict length)
{
    struct iovec part = {buffer, size};
    struct msghdr message = {.msg_name = address, .msg_iov = &part, .msg_iovlen = 1};
    ssize_t got;

    if (!is_can(fd) && !is_link(fd))
        return wait_readable(fd, flags) < 0 ? -1
                                            : REAL(recvfrom)(fd, buffer, size, flags, address,
                                                             length);
    if (address != NULL)
        message.msg_namelen = *length;
    got = recvmsg(fd, &message, flags);
    if (got >= 0 && address != NULL)
        *length = message.msg_namelen;
    return got;
}

EXPORT ssize_t recv(int fd, void *buffer, size_t size, int flags)
{
    if (is_can(fd))
        return recvfrom(fd, buffer, size, flags, NULL, NULL);
    return wait_readable(fd, flags) < 0 ? -1 : REAL(recv)(fd, buffer, size, flags);
}

EXPORT ssize_t read(int fd, void *buffer, size_t size)
{
    if (is_can(fd))
        return recvfrom(fd, buffer, size, 0, NULL, NULL);
    return wait_readable(fd, 0) < 0 ? -1 : REAL(read)(fd, buffer, size);
}

EXPORT ssize_t readv(int fd, const struct iovec *parts, int count)
{
    struct msghdr message = {.msg_iov = (struct iovec *)(uintptr_t)parts,
                             .msg_iovlen = (size_t)count};

    if (is_can(fd))
        return recvmsg(fd, &message, 0);
    return wait_readable(fd, 0) < 0 ? -1 : REAL(readv)(fd, parts, count);
}

/* What programs call that are built with _FORTIFY_SOURCE. */

EXPORT ssize_t __read_chk(int fd, void *buffer, size_t size, size_t room)
{
    if (size > room)
        __builtin_trap();
    return read(fd, buffer, size);
}

EXPORT ssize_t __recv_chk(int fd, void *buffer, size_t size, size_t room, int flags)
{
    if (size > room)
        __builtin_trap();
    return recv(fd, buffer, size, flags);
}

EXPORT ssize_t __recvfrom_chk(int fd, void *restrict buffer, size_t size, size_t room, int flags,
                              struct sockaddr *restrict address, socklen_t *restrict length)
{
    if (size > room)
        __builtin_trap();
    return recvfrom(fd, buffer, size, flags, address, length);
}
