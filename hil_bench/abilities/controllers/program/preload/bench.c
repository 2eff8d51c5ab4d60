#include "bench.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#define VERSION 1
#define FREE_CALLS 10000 /* a program that makes more between two waits spins */
#define CALL_TIME 1000  /* of each further one [ns] */

struct exchange *exchange;
static int control = -1, memory = -1; /* descriptors */

bool is_of_bench(int fd)
{
    return on_bench() && (fd == control || fd == memory);
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

/* Waits for the bench; false after a signal. */
static bool hear(const struct waiting *waiting)
{
    struct pollfd source = {.fd = control, .events = POLLIN};
    char byte;
    ssize_t got;

    if (!waiting->restarts && REAL(ppoll)(&source, 1, NULL, waiting->mask) < 0)
        return false;
    got = REAL(recv)(control, &byte, 1, 0);
    if (got < 0 && errno == EINTR)
        return false;
    if (got != 1)
        end();
    exchange->heard = exchange->grant;
    return true;
}

static void hear_surely(void)
{
    while (!hear(&(struct waiting){.restarts = true}))
        ;
}

void refuse(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(exchange->refusal, sizeof exchange->refusal, format, arguments);
    va_end(arguments);
    for (;;) {
        ring(IS_REFUSED);
        hear_surely();
    }
}

/* Claims the bench's time for this process. */
static void hold(void)
{
    int32_t self = getpid(), holder = exchange->holder;

    if (holder != 0 && holder != self && kill(holder, 0) == 0)
        refuse("forks: processes %d and %d live at once; with time = \"bench\" one does, and "
               "others wait for its end", holder, self);
    exchange->holder = self;
}

/* Gives the rest of its time back and waits for more; -1 after a signal. */
static int hand_over(int64_t wake, const struct waiting *waiting)
{
    bool is_heard;

    hold();
    exchange->wake = wake;
    exchange->state = ATTACHED | (waiting->watches_others ? WATCHES_OTHERS : 0);
    exchange->answered = exchange->heard;
    ring(WAITS);
    is_heard = hear(waiting);
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

/* Moves on to the next event; -1 after a signal. */
static int step(const struct waiting *waiting)
{
    int64_t next = earlier(waiting->deadline, earlier(next_timer(), next_frame()));

    if (next > exchange->until) {
        exchange->now = exchange->until;
        return hand_over(next, waiting);
    }
    if (next > exchange->now)
        exchange->now = next;
    while (next_frame() <= exchange->now) {
        deliver(&exchange->in[exchange->in_tail % RING]);
        exchange->in_tail++;
    }
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

    if (exchange->calls++ < FREE_CALLS)
        return;
    while (exchange->now < waiting.deadline)
        step(&waiting);
}

void send_record(const struct record *record)
{
    uint32_t head = exchange->out_head;

    while (head - atomic_load(&exchange->out_tail) == RING) {
        ring(IS_FULL);
        hear_surely();
    }
    exchange->out[head % RING] = *record;
    atomic_store(&exchange->out_head, head + 1);
}

static void in_child(void)
{
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
    if (exchange->version != VERSION)
        abort();
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    pthread_atfork(NULL, NULL, in_child);
    if (exchange->state & ATTACHED)
        return; /* a program that another one has started */
    hear_surely();
    exchange->state = ATTACHED;
}
