/* Waits for signals. */
#include "bench.h"

static const struct timespec AT_ONCE;

/* Lets in what waits; -1 with EINTR where something did. */
static int suspend_now(void *context)
{
    return REAL(ppoll)(NULL, 0, &AT_ONCE, context);
}

/* A process with a timer waits for bench time; one without, as a shell, for the end of a child. */
EXPORT int sigsuspend(const sigset_t *mask)
{
    if (!on_bench_time() || next_timer() == NEVER)
        return REAL(sigsuspend)(mask);
    return wait_for(suspend_now, (void *)(uintptr_t)mask,
                    &(struct waiting){.deadline = NEVER, .mask = mask});
}

struct arrival {
    const sigset_t *set;
    siginfo_t *about;
};

static int arrival_now(void *context)
{
    const struct arrival *arrival = context;
    const int number = REAL(sigtimedwait)(arrival->set, arrival->about, &AT_ONCE);

    return number < 0 && errno == EAGAIN ? 0 : number;
}

static int wait_signal(const sigset_t *set, siginfo_t *about, int64_t deadline)
{
    struct arrival arrival = {set, about};
    const struct waiting waiting = {.deadline = deadline, .watches_others = true};
    const int number = wait_for(arrival_now, &arrival, &waiting);

    if (number == 0) {
        errno = EAGAIN;
        return -1;
    }
    return number;
}

EXPORT int sigtimedwait(const sigset_t *restrict set, siginfo_t *restrict about,
                        const struct timespec *restrict timeout)
{
    if (!on_bench_time())
        return REAL(sigtimedwait)(set, about, timeout);
    return wait_signal(set, about, timeout == NULL ? NEVER : deadline_in(time_of(timeout)));
}

EXPORT int sigwaitinfo(const sigset_t *restrict set, siginfo_t *restrict about)
{
    return on_bench_time() ? wait_signal(set, about, NEVER) : REAL(sigwaitinfo)(set, about);
}

EXPORT int sigwait(const sigset_t *restrict set, int *restrict number)
{
    if (!on_bench_time())
        return REAL(sigwait)(set, number);
    *number = wait_signal(set, NULL, NEVER);
    return *number < 0 ? errno : 0;
}
