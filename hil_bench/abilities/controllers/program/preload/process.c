/* The process itself: descriptors that are closed and copied, threads, locks, random numbers. */
#include "netlink.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdarg.h>
#include <sys/random.h>
#include <unistd.h>

/* What stood behind a descriptor, unless it is a child's of vfork() that closes it. */
static void forget(int fd)
{
    if (on_bench() && !is_borrowed()) {
        forget_can(fd);
        forget_timer_fd(fd);
        forget_link(fd);
    }
}

EXPORT int close(int fd)
{
    if (is_of_bench(fd)) {
        errno = EBADF;
        return -1;
    }
    forget(fd);
    return REAL(close)(fd);
}

/* Closes all but the bench's ends, which programs need that this one starts. */
EXPORT int close_range(unsigned int first, unsigned int last, int flags)
{
    const unsigned int end = last < MOST_DESCRIPTORS ? last : MOST_DESCRIPTORS - 1;

    if (!on_bench())
        return REAL(close_range)(first, last, flags);
    for (; first <= end; first++) {
        if (is_of_bench((int)first))
            continue;
        if (!(flags & CLOSE_RANGE_CLOEXEC))
            forget((int)first);
        REAL(close_range)(first, first, flags);
    }
    return first <= last ? REAL(close_range)(first, last, flags) : 0;
}

EXPORT void closefrom(int first)
{
    if (on_bench())
        close_range(first < 0 ? 0 : (unsigned int)first, ~0U, 0);
    else
        REAL(closefrom)(first);
}

static int copied(int from, int to)
{
    if (to >= 0 && from != to && on_bench() && !is_borrowed())
        copy_can(from, to);
    return to;
}

EXPORT int dup(int fd)
{
    return copied(fd, REAL(dup)(fd));
}

EXPORT int dup2(int from, int to)
{
    if (is_of_bench(to)) {
        errno = EBADF;
        return -1;
    }
    return copied(from, REAL(dup2)(from, to));
}

EXPORT int dup3(int from, int to, int flags)
{
    if (is_of_bench(to)) {
        errno = EBADF;
        return -1;
    }
    return copied(from, REAL(dup3)(from, to, flags));
}

static int control_file(int fd, int command, void *argument)
{
    const int result = REAL(fcntl)(fd, command, argument);

    return command == F_DUPFD || command == F_DUPFD_CLOEXEC ? copied(fd, result) : result;
}

EXPORT int fcntl(int fd, int command, ...)
{
    va_list arguments;
    void *argument;

    va_start(arguments, command);
    argument = va_arg(arguments, void *);
    va_end(arguments);
    return control_file(fd, command, argument);
}

EXPORT int fcntl64(int fd, int command, ...)
{
    va_list arguments;
    void *argument;

    va_start(arguments, command);
    argument = va_arg(arguments, void *);
    va_end(arguments);
    return control_file(fd, command, argument);
}

EXPORT int pthread_create(pthread_t *restrict thread, const pthread_attr_t *restrict attributes,
                          void *(*start)(void *), void *restrict argument)
{
    if (on_bench_time())
        refuse("starts a thread; with time = \"bench\" a program has one");
    return REAL(pthread_create)(thread, attributes, start, argument);
}

/* In a program of one thread nobody else opens a lock: a wait for it is a sleep. */


/* The clock of a condition is not known; no machine has been up since 2001. */
static clockid_t likely_clock(const struct timespec *moment)
{
    return moment->tv_sec < 1000000000 ? CLOCK_MONOTONIC : CLOCK_REALTIME;
}

EXPORT int sem_clockwait(sem_t *restrict semaphore, clockid_t clock,
                         const struct timespec *restrict moment)
{
    if (!on_bench_time())
        return REAL(sem_clockwait)(semaphore, clock, moment);
    if (sem_trywait(semaphore) == 0)
        return 0;
    if (sleep_until(deadline_at(clock, moment)) < 0)
        return -1;
    if (sem_trywait(semaphore) == 0) /* a handler has posted it */
        return 0;
    errno = ETIMEDOUT;
    return -1;
}

EXPORT int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict moment)
{
    if (!on_bench_time())
        return REAL(sem_timedwait)(semaphore, moment);
    return sem_clockwait(semaphore, CLOCK_REALTIME, moment);
}

EXPORT int pthread_cond_clockwait(pthread_cond_t *restrict condition,
                                  pthread_mutex_t *restrict mutex, clockid_t clock,
                                  const struct timespec *restrict moment)
{
    if (!on_bench_time())
        return REAL(pthread_cond_clockwait)(condition, mutex, clock, moment);
    return sleep_until(deadline_at(clock, moment)) < 0 ? 0 : ETIMEDOUT; /* 0: woken for nothing */
}

EXPORT int pthread_cond_timedwait(pthread_cond_t *restrict condition,
                                  pthread_mutex_t *restrict mutex,
                                  const struct timespec *restrict moment)
{
    if (!on_bench_time())
        return REAL(pthread_cond_timedwait)(condition, mutex, moment);
    return pthread_cond_clockwait(condition, mutex, likely_clock(moment), moment);
}

/* The same random numbers in each run (xorshift32), which begins with a state other than 0. */

static unsigned char random_byte(void)
{
    exchange->random ^= exchange->random << 13;
    exchange->random ^= exchange->random >> 17;
    exchange->random ^= exchange->random << 5;
    return (unsigned char)(exchange->random >> 24);
}

EXPORT ssize_t getrandom(void *buffer, size_t size, unsigned int flags)
{
    unsigned char *bytes = buffer;

    if (!on_bench_time())
        return REAL(getrandom)(buffer, size, flags);
    for (size_t i = 0; i < size; i++)
        bytes[i] = random_byte();
    return (ssize_t)size;
}

EXPORT int getentropy(void *buffer, size_t size)
{
    if (!on_bench_time())
        return REAL(getentropy)(buffer, size);
    getrandom(buffer, size, 0);
    return 0;
}
