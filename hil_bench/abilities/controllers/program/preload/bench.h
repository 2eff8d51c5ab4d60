/* The bench as a preloaded program sees it: memory that both share, and time that the bench grants.
 *
 * The program lives by itself up to `until`. Where it would go on later than that, it says in `wake`
 * when, rings, and waits for the bench's answer. One process at a time lives.
 */
#ifndef HIL_BENCH_BENCH_H
#define HIL_BENCH_BENCH_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif

#include <dlfcn.h>
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/types.h>
#include <time.h>

#define EXPORT __attribute__((visibility("default")))

/* The function of this name that would be called without this library. */
#define REAL(function)                                                                             \
    ({                                                                                             \
        static void *found_;                                                                       \
        __typeof__(&function) real_;                                                               \
        if (found_ == NULL)                                                                        \
            found_ = dlsym(RTLD_NEXT, #function);                                                  \
        memcpy(&real_, &found_, sizeof real_);                                                     \
        real_;                                                                                     \
    })

#define RING 4096 /* frames; a power of 2 */
#define MOST_BUSES 16
#define MOST_DESCRIPTORS 1024 /* of the program, above which no CAN socket is */
#define NAME_SIZE 16
#define NEVER INT64_MAX
#define MILLISECOND INT64_C(1000000)
#define SECOND INT64_C(1000000000)

struct record {
    int64_t time; /* of the bench [ns] */
    uint32_t id;  /* with the flags of SocketCAN */
    uint8_t length;
    uint8_t bus; /* from 0 */
    uint8_t unused[2];
    uint8_t data[8];
};

/* What the program rings with; it begins without a ring. */
enum mark { IS_STARTED, WAITS = 'w', IS_FULL = 'f', IS_REFUSED = 'r' };
enum state { ATTACHED = 1, WATCHES_OTHERS = 2 };

/* Heads and tails count on for ever; `exchange.py` knows the offsets. */
struct exchange {
    /* of the bench */
    uint32_t version;
    uint32_t grant; /* its number */
    int64_t until;
    _Atomic uint32_t in_head;
    _Atomic uint32_t out_tail;
    uint16_t buses;
    uint16_t is_real; /* whether the program keeps the machine's clocks */
    uint32_t heard; /* of the program: the number of the last grant that it was rung for */
    char names[MOST_BUSES][NAME_SIZE];
    /* of the program */
    int64_t now;
    int64_t wake; /* when it would go on if nothing came */
    _Atomic uint32_t in_tail;
    _Atomic uint32_t out_head;
    uint32_t answered; /* the number of the last grant that it has lived to the end of */
    uint32_t state;
    int32_t holder; /* the process that waits, or in real time has the sockets; 0 for none */
    uint32_t random;
    uint32_t calls; /* since it last waited */
    char refusal[172]; /* why it cannot be run */
    struct record in[RING];
    struct record out[RING];
};
_Static_assert(sizeof(struct record) == 24, "as exchange.py has it");
_Static_assert(offsetof(struct exchange, now) == 288, "as exchange.py has it");
_Static_assert(offsetof(struct exchange, refusal) == 332, "as exchange.py has it");
_Static_assert(offsetof(struct exchange, in) == 504, "as exchange.py has it");

extern struct exchange *exchange; /* NULL where no bench is */

static inline bool on_bench(void)
{
    return exchange != NULL;
}

static inline bool on_bench_time(void)
{
    return exchange != NULL && !exchange->is_real;
}

struct waiting {
    int64_t deadline;     /* bench time, or NEVER */
    const sigset_t *mask; /* meanwhile, or NULL */
    bool watches_others;  /* descriptors whose other ends are not the bench */
    bool restarts;        /* after a handler with SA_RESTART, as read() does */
};

/* Lives on until `ready` returns other than 0, and returns that; 0 at the deadline; -1 with EINTR
 * after a signal. */
int wait_for(int (*ready)(void *), void *context, const struct waiting *waiting);

/* Sleeps; -1 with EINTR after a signal. */
int sleep_until(int64_t deadline);

/* A call that did not wait: those of a program that spins take time. */
void count_call(void);

/* Hands a frame over to the bench; false where there is no room for it. */
bool send_record(const struct record *record);

/* The time of a frame that is sent now. */
int64_t present(void);

/* In real time other threads are about: one at a time touches sockets and frames. */
void lock(void);
void unlock(void);

/* Begins to hand out frames in real time; false where another process does, with EBUSY. */
bool start_pump(void);

/* Says why the program cannot be run, and never returns. */
_Noreturn void refuse(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Whether the bench's end of anything is at this descriptor, which the program must not close. */
bool is_of_bench(int fd);

/* Whether this is a child of vfork(), whose memory is its parent's. */
bool is_borrowed(void);

/* clock.c */
int64_t time_of(const struct timespec *span);
int64_t deadline_in(int64_t span);
int64_t deadline_at(clockid_t clock, const struct timespec *moment);
struct timespec span_of(int64_t time);
int64_t wall_time(int64_t bench_time);
bool is_of_cpu(clockid_t clock);

/* timers.c */
int64_t next_timer(void);
bool fire_timers(void); /* those that are due; whether a handler has run */
bool is_timer_fd(int fd);
void forget_timer_fd(int fd);

/* can_socket.c */
void deliver(const struct record *record);
bool is_can(int fd);
int64_t patience_of(int fd); /* of a read of a CAN socket [ns] */
void forget_can(int fd);
void copy_can(int from, int to);

/* waits.c */
int wait_readable(int fd, int flags);

/* names.c */
int bus_of_name(const char *name); /* -1 for none */
int bus_of_index(int index);
#define FIRST_INDEX 3 /* of the first bus, among network interfaces */

#endif
