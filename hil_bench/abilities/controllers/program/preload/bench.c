#include "bench.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define VERSION 1
#define FREE_CALLS 10000 /* a program that makes more between two waits spins */
#define CALL_TIME 1000  /* of each further one [ns] */
#define MOST_MOMENTS 10000 /* of a millisecond, for a child that does nothing */

struct exchange *exchange;
static int control = -1, memory = -1; /* descriptors */
static int arrivals = -1;             /* of signals */
static pid_t self;

bool is_borrowed(void)
{
    return getpid() != self;
}

bool is_of_bench(int fd)
{
    return on_bench() && (fd == control || fd == memory || fd == arrivals);
}

static _Noreturn void end(void)
{
    kill(getpid(), SIGKILL); /* the bench is gone */
    for (;;)
        REAL(pause)();
}

static void ring(enum mark mark)
{
    char byte = (char)mark;
    ssize_t sent;

    do
        sent = REAL(send)(control, &byte, 1, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    if (sent != 1)
        end();
}

/* Lets signals in that wait; whether one ends a call, as a handler does without SA_RESTART. */
static bool let_in(const sigset_t *blocked, const struct waiting *waiting)
{
    sigset_t all, pending;
    bool is_end = false;

    sigpending(&pending);
    for (int number = 1; number < NSIG; number++) {
        struct sigaction action;

        if (sigismember(&pending, number) != 1 || sigismember(blocked, number) != 0 ||
            sigaction(number, NULL, &action) < 0)
            continue;
        is_end |= action.sa_handler != SIG_IGN && action.sa_handler != SIG_DFL &&
                  !(waiting->restarts && (action.sa_flags & SA_RESTART));
    }
    sigfillset(&all);
    sigprocmask(SIG_SETMASK, blocked, NULL); /* now handlers run */
    sigprocmask(SIG_SETMASK, &all, NULL);
    return is_end;
}

static void take_bell(void)
{
    char byte;

    if (REAL(recv)(control, &byte, 1, 0) != 1)
        end();
    exchange->heard = exchange->grant;
}

/* Rings and waits for the bench; false where a signal ends the call, rung back or not. */
static bool exchange_bells(enum mark mark, const struct waiting *waiting)
{
    struct pollfd sources[] = {{.fd = control, .events = POLLIN}, {.events = POLLIN}};
    sigset_t all, before, blocked, open;
    bool is_rung = false, is_ended = false;

    sigfillset(&all);
    sigprocmask(SIG_SETMASK, &all, &before);
    blocked = waiting->mask != NULL ? *waiting->mask : before;
    sigemptyset(&open);
    for (int number = 1; number < NSIG; number++)
        if (sigismember(&blocked, number) == 0)
            sigaddset(&open, number);
    arrivals = sources[1].fd = signalfd(arrivals, &open, SFD_CLOEXEC | SFD_NONBLOCK);
    if (mark != IS_STARTED)
        ring(mark);
    while (!is_rung && !is_ended) {
        REAL(ppoll)(sources, 2, NULL, NULL);
        if (sources[0].revents) {
            take_bell();
            is_rung = true;
        }
        if (sources[1].revents)
            is_ended = let_in(&blocked, waiting);
    }
    sigprocmask(SIG_SETMASK, &before, NULL);
    return !is_ended;
}

/* The same, and no signal gets in meanwhile. */
static void exchange_bells_alone(enum mark mark)
{
    sigset_t all;

    sigfillset(&all);
    exchange_bells(mark, &(struct waiting){.mask = &all});
}

void refuse(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(exchange->refusal, sizeof exchange->refusal, format, arguments);
    va_end(arguments);
    for (;;)
        exchange_bells_alone(IS_REFUSED);
}

static _Noreturn void refuse_two(void)
{
    refuse("forks: two processes live at once; with time = \"bench\" one does, and others wait for "
           "its end");
}

/* Claims the bench's time for this process. */
static void hold(void)
{
    const int32_t holder = exchange->holder;

    if (holder != 0 && holder != self && kill(holder, 0) == 0)
        refuse_two();
    exchange->holder = self;
}

static bool has_child(void)
{
    siginfo_t ended = {0};

    return waitid(P_ALL, 0, &ended, WEXITED | WNOHANG | WNOWAIT) == 0 && ended.si_pid == 0;
}

/* Waits a moment for a child, which lives meanwhile; -1 after a signal. No time of this process
 * passes: how long a child takes differs from run to run. */
static int wait_for_child(const struct waiting *waiting)
{
    static const struct timespec moment = {.tv_nsec = MILLISECOND};
    static int64_t last_now;
    static int moments;

    if (exchange->now != last_now)
        moments = 0;
    last_now = exchange->now;
    if (!waiting->watches_others || ++moments > MOST_MOMENTS)
        refuse_two();
    return REAL(ppoll)(NULL, 0, &moment, waiting->mask);
}

/* Gives the rest of its time back and waits for more; -1 after a signal. */
static int hand_over(int64_t wake, const struct waiting *waiting)
{
    bool is_heard;

    hold();
    exchange->wake = wake;
    exchange->state = ATTACHED | (waiting->watches_others ? WATCHES_OTHERS : 0);
    exchange->answered = exchange->heard;
    is_heard = exchange_bells(WAITS, waiting);
    exchange->holder = 0;
    return is_heard ? 0 : -1;
}

static bool has_frame(void)
{
    return atomic_load(&exchange->in_head) != exchange->in_tail;
}

static int64_t next_frame(void)
{
    return has_frame() ? exchange->in[exchange->in_tail % RING].time : NEVER;
}

static int64_t earlier(int64_t one, int64_t other)
{
    return one < other ? one : other;
}

static void deliver_next(void)
{
    deliver(&exchange->in[exchange->in_tail % RING]);
    exchange->in_tail++;
}

/* Moves on to the next event; -1 after a signal. */
static int step(const struct waiting *waiting)
{
    int64_t next = earlier(waiting->deadline, earlier(next_timer(), next_frame()));

    if (next > exchange->until) {
        if (has_child())
            return wait_for_child(waiting);
        exchange->now = exchange->until;
        return hand_over(next, waiting);
    }
    if (next > exchange->now)
        exchange->now = next;
    while (next_frame() <= exchange->now)
        deliver_next();
    return fire_timers() ? -1 : 0;
}

int wait_for(int (*ready)(void *), void *context, const struct waiting *waiting)
{
    for (;;) {
        int result = ready(context);

        if (result != 0)
            return result;
        if (exchange->now >= waiting->deadline) {
            count_call();
            return 0;
        }
        exchange->calls = 0;
        if (step(waiting) < 0) {
            errno = EINTR;
            return -1;
        }
    }
}

static int never(void *context)
{
    (void)context;
    return 0;
}

int sleep_until(int64_t deadline)
{
    return wait_for(never, NULL, &(struct waiting){.deadline = deadline});
}

void count_call(void)
{
    struct waiting waiting = {.deadline = exchange->now + CALL_TIME, .restarts = true};

    if (exchange->is_real || exchange->calls++ < FREE_CALLS)
        return;
    while (exchange->now < waiting.deadline)
        step(&waiting);
}

bool send_record(const struct record *record)
{
    uint32_t head = exchange->out_head;

    while (head - atomic_load(&exchange->out_tail) == RING) {
        if (exchange->is_real)
            return false;
        exchange_bells_alone(IS_FULL);
    }
    exchange->out[head % RING] = *record;
    atomic_store(&exchange->out_head, head + 1);
    return true;
}

int64_t present(void)
{
    struct timespec now;

    if (!exchange->is_real)
        return exchange->now;
    REAL(clock_gettime)(CLOCK_REALTIME, &now);
    return time_of(&now) - wall_time(0);
}

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;

void lock(void)
{
    if (exchange->is_real)
        pthread_mutex_lock(&mutex);
}

void unlock(void)
{
    if (exchange->is_real)
        pthread_mutex_unlock(&mutex);
}

/* Hands out what has come whenever the bench rings. */
static void *pump(void *unused)
{
    char bells[64];

    while (REAL(recv)(control, bells, sizeof bells, 0) > 0) {
        lock();
        while (has_frame())
            deliver_next();
        unlock();
    }
    end();
    return unused;
}

bool start_pump(void)
{
    sigset_t all, before;
    pthread_t thread;
    int error;

    if (exchange->holder == self)
        return true;
    if (exchange->holder != 0 && kill(exchange->holder, 0) == 0) {
        errno = EBUSY;
        return false;
    }
    exchange->in_tail = atomic_load(&exchange->in_head); /* nobody has heard those */
    sigfillset(&all);
    sigprocmask(SIG_SETMASK, &all, &before);
    error = REAL(pthread_create)(&thread, NULL, pump, NULL);
    sigprocmask(SIG_SETMASK, &before, NULL);
    if (error) {
        errno = error;
        return false;
    }
    pthread_detach(thread);
    exchange->holder = self;
    return true;
}

static void in_child(void)
{
    self = getpid();
    prctl(PR_SET_PDEATHSIG, SIGKILL);
}

__attribute__((constructor)) static void attach(void)
{
    const char *descriptors = getenv("HIL_BENCH_PROGRAM");
    void *mapped;

    if (descriptors == NULL || sscanf(descriptors, "%d,%d", &control, &memory) != 2)
        return;
    mapped = mmap(NULL, sizeof *exchange, PROT_READ | PROT_WRITE, MAP_SHARED, memory, 0);
    if (mapped == MAP_FAILED)
        return; /* the descriptors were closed before this program was started */
    exchange = mapped;
    self = getpid();
    if (exchange->version != VERSION)
        abort();
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    pthread_atfork(NULL, NULL, in_child);
    if (exchange->is_real) {
        exchange->state = ATTACHED;
        return;
    }
    if (exchange->state & ATTACHED)
        return; /* a program that another one has started */
    exchange_bells_alone(IS_STARTED);
    exchange->state = ATTACHED;
}
