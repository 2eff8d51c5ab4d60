/* Timers of bench time: descriptors, alarms, and POSIX timers that send a signal. */
#include "bench.h"

#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <unistd.h>

#define MOST_TIMERS 64
#define ALARM 0 /* the timer of alarm() and setitimer() */

enum kind { UNUSED, SIGNALS, COUNTS };

struct timer {
    enum kind kind;
    int target; /* the signal, or the descriptor: an eventfd in place of a timerfd */
    clockid_t clock;
    int64_t due; /* NEVER while it is off */
    int64_t interval; /* 0 for once */
    union sigval value;
};

static struct timer timers[MOST_TIMERS] = {
    [ALARM] = {.kind = SIGNALS, .target = SIGALRM, .due = NEVER}};

int64_t next_timer(void)
{
    int64_t next = NEVER;

    for (int i = 0; i < MOST_TIMERS; i++)
        if (timers[i].kind != UNUSED && timers[i].due < next)
            next = timers[i].due;
    return next;
}

/* Whether a handler runs on a signal now; it waits while it is blocked. */
static bool is_handled(int number)
{
    struct sigaction action;
    sigset_t blocked;

    sigaction(number, NULL, &action);
    sigprocmask(SIG_SETMASK, NULL, &blocked);
    return action.sa_handler != SIG_IGN && !sigismember(&blocked, number);
}

/* Sends what is due of a timer; whether a handler has run. */
static bool fire(struct timer *timer)
{
    uint64_t times = 1;
    siginfo_t about = {.si_signo = timer->target, .si_code = SI_TIMER};
    bool is_seen;

    if (timer->interval > 0)
        times += (uint64_t)((exchange->now - timer->due) / timer->interval);
    timer->due = timer->interval > 0 ? timer->due + (int64_t)times * timer->interval : NEVER;
    if (timer->kind == COUNTS) {
        if (REAL(write)(timer->target, &times, sizeof times) < 0)
            errno = 0; /* nobody has read it for 2^64 times */
        return false;
    }
    is_seen = is_handled(timer->target);
    if (timer == &timers[ALARM]) {
        raise(timer->target);
    } else {
        about.si_value = timer->value;
        syscall(SYS_rt_sigqueueinfo, getpid(), timer->target, &about);
    }
    return is_seen;
}

bool fire_timers(void)
{
    bool is_seen = false;

    for (int i = 0; i < MOST_TIMERS; i++)
        if (timers[i].kind != UNUSED && timers[i].due <= exchange->now)
            is_seen |= fire(&timers[i]);
    return is_seen;
}

static struct timer *new_timer(enum kind kind, int target, clockid_t clock)
{
    for (int i = ALARM + 1; i < MOST_TIMERS; i++)
        if (timers[i].kind == UNUSED) {
            timers[i] = (struct timer){kind, target, clock, NEVER, 0, {0}};
            return &timers[i];
        }
    errno = EMFILE;
    return NULL;
}

static struct timer *timer_at(int fd)
{
    for (int i = 0; on_bench_time() && i < MOST_TIMERS; i++)
        if (timers[i].kind == COUNTS && timers[i].target == fd)
            return &timers[i];
    return NULL;
}

bool is_timer_fd(int fd)
{
    return timer_at(fd) != NULL;
}

void forget_timer_fd(int fd)
{
    struct timer *timer = timer_at(fd);

    if (timer != NULL)
        timer->kind = UNUSED;
}

static void state_of(const struct timer *timer, struct itimerspec *state)
{
    state->it_interval = span_of(timer->interval);
    state->it_value = span_of(timer->due == NEVER ? 0 : timer->due - exchange->now);
}

static int set(struct timer *timer, bool is_absolute, const struct itimerspec *wanted,
               struct itimerspec *before)
{
    const int64_t first = time_of(&wanted->it_value);

    if (before != NULL)
        state_of(timer, before);
    timer->interval = time_of(&wanted->it_interval);
    if (first == 0)
        timer->due = NEVER;
    else
        timer->due = is_absolute ? deadline_at(timer->clock, &wanted->it_value)
                                 : deadline_in(first);
    return 0;
}

EXPORT int timerfd_create(clockid_t clock, int flags)
{
    int fd;

    if (!on_bench_time())
        return REAL(timerfd_create)(clock, flags);
    fd = eventfd(0, (flags & TFD_NONBLOCK ? EFD_NONBLOCK : 0) |
                        (flags & TFD_CLOEXEC ? EFD_CLOEXEC : 0));
    if (fd >= 0 && new_timer(COUNTS, fd, clock) == NULL) {
        REAL(close)(fd);
        return -1;
    }
    return fd;
}

EXPORT int timerfd_settime(int fd, int flags, const struct itimerspec *wanted,
                           struct itimerspec *before)
{
    struct timer *timer = timer_at(fd);
    uint64_t old;

    if (timer == NULL)
        return REAL(timerfd_settime)(fd, flags, wanted, before);
    if (poll(&(struct pollfd){.fd = fd, .events = POLLIN}, 1, 0) > 0 &&
        REAL(read)(fd, &old, sizeof old) < 0)
        return -1;
    return set(timer, flags & TFD_TIMER_ABSTIME, wanted, before);
}

EXPORT int timerfd_gettime(int fd, struct itimerspec *state)
{
    struct timer *timer = timer_at(fd);

    if (timer == NULL)
        return REAL(timerfd_gettime)(fd, state);
    state_of(timer, state);
    return 0;
}

EXPORT int timer_create(clockid_t clock, struct sigevent *restrict event,
                        timer_t *restrict identity)
{
    struct timer *timer;

    if (!on_bench_time() || is_of_cpu(clock))
        return REAL(timer_create)(clock, event, identity);
    if (event != NULL && event->sigev_notify == SIGEV_THREAD)
        refuse("starts a thread by timer_create(); with time = \"bench\" it has one");
    timer = new_timer(SIGNALS, event == NULL ? SIGALRM : event->sigev_signo, clock);
    if (timer == NULL)
        return -1;
    if (event != NULL)
        timer->value = event->sigev_value;
    if (event != NULL && event->sigev_notify == SIGEV_NONE)
        timer->target = 0; /* no signal: raising it does nothing */
    *identity = timer;
    return 0;
}

static bool is_own(timer_t identity)
{
    return on_bench_time() && identity > (void *)timers && identity < (void *)(timers + MOST_TIMERS);
}

EXPORT int timer_settime(timer_t identity, int flags, const struct itimerspec *restrict wanted,
                         struct itimerspec *restrict before)
{
    if (!is_own(identity))
        return REAL(timer_settime)(identity, flags, wanted, before);
    return set(identity, flags & TIMER_ABSTIME, wanted, before);
}

EXPORT int timer_gettime(timer_t identity, struct itimerspec *state)
{
    if (!is_own(identity))
        return REAL(timer_gettime)(identity, state);
    state_of(identity, state);
    return 0;
}

EXPORT int timer_getoverrun(timer_t identity)
{
    return is_own(identity) ? 0 : REAL(timer_getoverrun)(identity);
}

EXPORT int timer_delete(timer_t identity)
{
    if (!is_own(identity))
        return REAL(timer_delete)(identity);
    ((struct timer *)identity)->kind = UNUSED;
    return 0;
}

static struct itimerspec of_timeval(const struct itimerval *rough)
{
    return (struct itimerspec){
        .it_interval = {rough->it_interval.tv_sec, rough->it_interval.tv_usec * 1000},
        .it_value = {rough->it_value.tv_sec, rough->it_value.tv_usec * 1000},
    };
}

static void to_timeval(const struct itimerspec *fine, struct itimerval *rough)
{
    rough->it_interval = (struct timeval){fine->it_interval.tv_sec,
                                          fine->it_interval.tv_nsec / 1000};
    rough->it_value = (struct timeval){fine->it_value.tv_sec, fine->it_value.tv_nsec / 1000};
}

EXPORT int setitimer(__itimer_which_t which, const struct itimerval *restrict wanted,
                     struct itimerval *restrict before)
{
    struct itimerspec fine, old;

    if (!on_bench_time() || which != ITIMER_REAL)
        return REAL(setitimer)(which, wanted, before);
    fine = of_timeval(wanted);
    set(&timers[ALARM], false, &fine, &old);
    if (before != NULL)
        to_timeval(&old, before);
    return 0;
}

EXPORT int getitimer(__itimer_which_t which, struct itimerval *state)
{
    struct itimerspec fine;

    if (!on_bench_time() || which != ITIMER_REAL)
        return REAL(getitimer)(which, state);
    state_of(&timers[ALARM], &fine);
    to_timeval(&fine, state);
    return 0;
}

EXPORT unsigned int alarm(unsigned int seconds)
{
    struct itimerval wanted = {.it_value = {.tv_sec = seconds}}, before;

    if (!on_bench_time())
        return REAL(alarm)(seconds);
    setitimer(ITIMER_REAL, &wanted, &before);
    return (unsigned int)(before.it_value.tv_sec + (before.it_value.tv_usec > 0));
}
