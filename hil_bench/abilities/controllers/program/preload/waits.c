/* Waits for descriptors: poll, select, epoll, and reads that block. */
#include "bench.h"

#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

static const struct timespec AT_ONCE;

static int64_t deadline_ms(int timeout)
{
    return timeout < 0 ? NEVER : deadline_in(timeout * MILLISECOND);
}

static int64_t deadline_of(const struct timespec *timeout)
{
    return timeout == NULL ? NEVER : deadline_in(time_of(timeout));
}

static bool is_ours(int fd)
{
    return is_can(fd) || is_timer_fd(fd);
}

struct poll_set {
    struct pollfd *sources;
    nfds_t count;
    const sigset_t *mask;
};

static int poll_now(void *context)
{
    const struct poll_set *set = context;

    return REAL(ppoll)(set->sources, set->count, &AT_ONCE, set->mask);
}

static int wait_poll(struct poll_set set, int64_t deadline)
{
    struct waiting waiting = {.deadline = deadline, .mask = set.mask};

    for (nfds_t i = 0; i < set.count; i++)
        waiting.watches_others |= set.sources[i].fd >= 0 && !is_ours(set.sources[i].fd);
    return wait_for(poll_now, &set, &waiting);
}

EXPORT int poll(struct pollfd *sources, nfds_t count, int timeout)
{
    if (!on_bench_time())
        return REAL(poll)(sources, count, timeout);
    return wait_poll((struct poll_set){sources, count, NULL}, deadline_ms(timeout));
}

EXPORT int ppoll(struct pollfd *sources, nfds_t count, const struct timespec *timeout,
                 const sigset_t *mask)
{
    if (!on_bench_time())
        return REAL(ppoll)(sources, count, timeout, mask);
    return wait_poll((struct poll_set){sources, count, mask}, deadline_of(timeout));
}

EXPORT int __poll_chk(struct pollfd *sources, nfds_t count, int timeout, size_t room)
{
    if (room / sizeof *sources < count)
        __builtin_trap();
    return poll(sources, count, timeout);
}

EXPORT int __ppoll_chk(struct pollfd *sources, nfds_t count, const struct timespec *timeout,
                       const sigset_t *mask, size_t room)
{
    if (room / sizeof *sources < count)
        __builtin_trap();
    return ppoll(sources, count, timeout, mask);
}

struct select_set {
    int count;
    fd_set *sets[3]; /* of the program, which get what is ready */
    fd_set wanted[3];
    const sigset_t *mask;
};

static int select_now(void *context)
{
    struct select_set *set = context;
    fd_set found[3];
    fd_set *places[3];
    int result;

    for (int i = 0; i < 3; i++) {
        found[i] = set->wanted[i];
        places[i] = set->sets[i] == NULL ? NULL : &found[i];
    }
    result = REAL(pselect)(set->count, places[0], places[1], places[2], &AT_ONCE, set->mask);
    for (int i = 0; i < 3 && result >= 0; i++)
        if (set->sets[i] != NULL)
            *set->sets[i] = found[i];
    return result;
}

static int wait_select(struct select_set *set, int64_t deadline)
{
    struct waiting waiting = {.deadline = deadline, .mask = set->mask};

    for (int i = 0; i < 3; i++) {
        if (set->sets[i] == NULL)
            continue;
        set->wanted[i] = *set->sets[i];
        for (int fd = 0; fd < set->count; fd++)
            waiting.watches_others |= FD_ISSET(fd, set->sets[i]) && !is_ours(fd);
    }
    return wait_for(select_now, set, &waiting);
}

EXPORT int pselect(int count, fd_set *restrict readable, fd_set *restrict writable,
                   fd_set *restrict exceptional, const struct timespec *restrict timeout,
                   const sigset_t *restrict mask)
{
    struct select_set set = {
        .count = count, .sets = {readable, writable, exceptional}, .mask = mask};

    if (!on_bench_time())
        return REAL(pselect)(count, readable, writable, exceptional, timeout, mask);
    return wait_select(&set, deadline_of(timeout));
}

EXPORT int select(int count, fd_set *restrict readable, fd_set *restrict writable,
                  fd_set *restrict exceptional, struct timeval *restrict timeout)
{
    struct select_set set = {.count = count, .sets = {readable, writable, exceptional}};
    int64_t deadline = NEVER;
    int result;

    if (!on_bench_time())
        return REAL(select)(count, readable, writable, exceptional, timeout);
    if (timeout != NULL)
        deadline = deadline_in(timeout->tv_sec * SECOND + timeout->tv_usec * 1000);
    result = wait_select(&set, deadline);
    if (timeout != NULL) { /* Linux leaves the rest there */
        timeout->tv_sec = (deadline - exchange->now) / SECOND;
        timeout->tv_usec = (deadline - exchange->now) % SECOND / 1000;
    }
    return result;
}

struct epoll_set {
    int fd;
    struct epoll_event *events;
    int room;
    const sigset_t *mask;
};

static int epoll_now(void *context)
{
    const struct epoll_set *set = context;

    return REAL(epoll_pwait)(set->fd, set->events, set->room, 0, set->mask);
}

static int wait_epoll(struct epoll_set set, int64_t deadline)
{
    /* It may hold anything. */
    const struct waiting waiting = {
        .deadline = deadline, .mask = set.mask, .watches_others = true};

    return wait_for(epoll_now, &set, &waiting);
}

EXPORT int epoll_wait(int fd, struct epoll_event *events, int room, int timeout)
{
    if (!on_bench_time())
        return REAL(epoll_wait)(fd, events, room, timeout);
    return wait_epoll((struct epoll_set){fd, events, room, NULL}, deadline_ms(timeout));
}

EXPORT int epoll_pwait(int fd, struct epoll_event *events, int room, int timeout,
                       const sigset_t *mask)
{
    if (!on_bench_time())
        return REAL(epoll_pwait)(fd, events, room, timeout, mask);
    return wait_epoll((struct epoll_set){fd, events, room, mask}, deadline_ms(timeout));
}

EXPORT int epoll_pwait2(int fd, struct epoll_event *events, int room,
                        const struct timespec *timeout, const sigset_t *mask)
{
    if (!on_bench_time())
        return REAL(epoll_pwait2)(fd, events, room, timeout, mask);
    return wait_epoll((struct epoll_set){fd, events, room, mask}, deadline_of(timeout));
}

static bool is_nonblocking(int fd)
{
    return (REAL(fcntl)(fd, F_GETFL) & O_NONBLOCK) != 0;
}

/* The time limit of a socket's reads; NEVER where it has none. */
static int64_t receive_deadline(int fd)
{
    struct timeval limit = {0};
    socklen_t length = sizeof limit;

    if (is_can(fd))
        return deadline_in(patience_of(fd));
    if (REAL(getsockopt)(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, &length) < 0 ||
        (limit.tv_sec == 0 && limit.tv_usec == 0))
        return NEVER;
    return deadline_in(limit.tv_sec * SECOND + limit.tv_usec * 1000);
}

/* The other end of a pipe is a process that this one has started, and which lives meanwhile. */
static bool is_pipe(int fd)
{
    struct stat status;

    return fstat(fd, &status) == 0 && S_ISFIFO(status.st_mode);
}

int wait_readable(int fd, int flags)
{
    struct pollfd source = {.fd = fd, .events = POLLIN};
    struct poll_set set = {&source, 1, NULL};
    struct waiting waiting = {.watches_others = !is_ours(fd), .restarts = true};
    int result;

    if (!on_bench_time() || is_of_bench(fd) || poll_now(&set) != 0)
        return 0;
    if ((flags & MSG_DONTWAIT) || is_nonblocking(fd)) {
        count_call();
        errno = EAGAIN;
        return -1;
    }
    if (is_pipe(fd))
        return 0;
    waiting.deadline = receive_deadline(fd);
    result = wait_for(poll_now, &set, &waiting);
    if (result == 0)
        errno = EAGAIN;
    return result > 0 ? 0 : -1;
}

EXPORT int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict length, int flags)
{
    return wait_readable(fd, 0) < 0 ? -1 : REAL(accept4)(fd, address, length, flags);
}

EXPORT int accept(int fd, struct sockaddr *restrict address, socklen_t *restrict length)
{
    return accept4(fd, address, length, 0);
}
