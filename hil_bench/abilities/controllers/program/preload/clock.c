/* Clocks that show bench time, and sleep. */
#include "bench.h"

#include <sys/time.h>
#include <sys/times.h>
#include <unistd.h>

#define EPOCH (INT64_C(1767225600) * SECOND) /* wall time when the bench starts: 2026-01-01 UTC */
#define UPTIME (100 * SECOND) /* of the machine at that moment, which CLOCK_MONOTONIC counts */

int64_t time_of(const struct timespec *span)
{
    if (span->tv_sec >= NEVER / SECOND)
        return NEVER;
    return span->tv_sec * SECOND + span->tv_nsec;
}

struct timespec span_of(int64_t time)
{
    return (struct timespec){.tv_sec = time / SECOND, .tv_nsec = time % SECOND};
}

int64_t wall_time(int64_t bench_time)
{
    return EPOCH + bench_time;
}

int64_t deadline_in(int64_t span)
{
    return span > NEVER - exchange->now ? NEVER : exchange->now + span;
}

bool is_of_cpu(clockid_t clock)
{
    return clock == CLOCK_PROCESS_CPUTIME_ID || clock == CLOCK_THREAD_CPUTIME_ID || clock < 0;
}

static int64_t zero_of(clockid_t clock)
{
    switch (clock) {
    case CLOCK_REALTIME:
    case CLOCK_REALTIME_COARSE:
    case CLOCK_REALTIME_ALARM:
    case CLOCK_TAI:
        return EPOCH;
    default:
        return UPTIME;
    }
}

int64_t deadline_at(clockid_t clock, const struct timespec *moment)
{
    int64_t time = time_of(moment);

    return time == NEVER ? NEVER : time - zero_of(clock);
}

static bool is_span(const struct timespec *span)
{
    return span->tv_sec >= 0 && span->tv_nsec >= 0 && span->tv_nsec < SECOND;
}

EXPORT int clock_gettime(clockid_t clock, struct timespec *now)
{
    if (!on_bench_time() || is_of_cpu(clock))
        return REAL(clock_gettime)(clock, now);
    count_call();
    *now = span_of(zero_of(clock) + exchange->now);
    return 0;
}

EXPORT int timespec_get(struct timespec *now, int base)
{
    if (!on_bench_time() || base != TIME_UTC)
        return REAL(timespec_get)(now, base);
    clock_gettime(CLOCK_REALTIME, now);
    return base;
}

EXPORT int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec time;

    if (!on_bench_time())
        return REAL(gettimeofday)(now, zone);
    clock_gettime(CLOCK_REALTIME, &time);
    now->tv_sec = time.tv_sec;
    now->tv_usec = time.tv_nsec / 1000;
    return 0;
}

EXPORT time_t time(time_t *now)
{
    struct timespec moment;

    if (!on_bench_time())
        return REAL(time)(now);
    clock_gettime(CLOCK_REALTIME, &moment);
    if (now != NULL)
        *now = moment.tv_sec;
    return moment.tv_sec;
}

EXPORT clock_t times(struct tms *used)
{
    struct timespec now;

    if (!on_bench_time())
        return REAL(times)(used);
    clock_gettime(CLOCK_MONOTONIC, &now);
    return REAL(times)(used) < 0 ? -1 : time_of(&now) * sysconf(_SC_CLK_TCK) / SECOND;
}

EXPORT int clock_nanosleep(clockid_t clock, int flags, const struct timespec *request,
                           struct timespec *rest)
{
    int64_t deadline;

    if (!on_bench_time() || is_of_cpu(clock))
        return REAL(clock_nanosleep)(clock, flags, request, rest);
    if (!is_span(request))
        return EINVAL;
    if (flags & TIMER_ABSTIME)
        deadline = deadline_at(clock, request);
    else
        deadline = deadline_in(time_of(request));
    if (sleep_until(deadline) == 0)
        return 0;
    if (rest != NULL && !(flags & TIMER_ABSTIME))
        *rest = span_of(deadline - exchange->now);
    return EINTR;
}

EXPORT int nanosleep(const struct timespec *request, struct timespec *rest)
{
    int error;

    if (!on_bench_time())
        return REAL(nanosleep)(request, rest);
    error = clock_nanosleep(CLOCK_MONOTONIC, 0, request, rest);
    if (error)
        errno = error;
    return error ? -1 : 0;
}

EXPORT int usleep(useconds_t microseconds)
{
    if (!on_bench_time())
        return REAL(usleep)(microseconds);
    return sleep_until(deadline_in((int64_t)microseconds * 1000));
}

EXPORT unsigned int sleep(unsigned int seconds)
{
    int64_t deadline;

    if (!on_bench_time())
        return REAL(sleep)(seconds);
    deadline = deadline_in(seconds * SECOND);
    if (sleep_until(deadline) == 0)
        return 0;
    return (unsigned int)((deadline - exchange->now + SECOND - 1) / SECOND);
}

EXPORT int pause(void)
{
    if (!on_bench_time())
        return REAL(pause)();
    return sleep_until(NEVER);
}
