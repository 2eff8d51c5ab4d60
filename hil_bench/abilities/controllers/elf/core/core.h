/* A core of unicorn's with what unicorn lacks: what the parts of it share. */
#ifndef HIL_BENCH_CORE_H
#define HIL_BENCH_CORE_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <structmember.h>

__extension__ typedef __int128 wide;
__extension__ typedef unsigned __int128 bits; /* one for each exception */

/* Why a core came to its end, beside unicorn's numbers of traps (2 of an SVC, 8 of a branch to EXC_RETURN). */
enum { SLEEPS = -1, WAITS = -2, UNALIGNED = -4, PAUSES = -5, NO_ROOM = -6, NO_EXCEPTION = -7, NO_FRAME = -8 };
#define ERRORS 1000 /* and unicorn's number */
enum { TRAP_CALL = 2, TRAP_RETURN = 8 };

/* unicorn's functions, as `use` was given them. */
typedef uint64_t (*read_function)(void *engine, uint64_t offset, unsigned size, void *data);
typedef void (*write_function)(void *engine, uint64_t offset, unsigned size, uint64_t value, void *data);
extern int (*uc_emu_start)(void *, uint64_t, uint64_t, uint64_t, size_t);
extern int (*uc_emu_stop)(void *);
extern int (*uc_mem_read)(void *, uint64_t, void *, size_t);
extern int (*uc_mem_write)(void *, uint64_t, const void *, size_t);
extern int (*uc_reg_read_batch)(void *, int *, void **, int);
extern int (*uc_reg_write_batch)(void *, int *, void *const *, int);
extern int (*uc_mmio_map)(void *, uint64_t, size_t, read_function, void *, write_function, void *);
extern int (*uc_hook_add)(void *, size_t *, int, void *, void *, uint64_t, uint64_t, ...);

/* unicorn's numbers. */
enum { FPSCR = 6, LR = 10, PC = 11, SP = 12, R0 = 66, S0 = 79, MSP = 115, PSP, CONTROL, XPSR = 120 };
enum { PRIMASK = 123, BASEPRI = 124, FAULTMASK = 126 };
#define MOST_REGISTERS 32

/* What is due, in order of time, then of its number. */
struct alarm {
    PyObject_HEAD
    long long time;
    PyObject *action;
    char is_on; /* until it is over or was cancelled */
};
struct entry {
    long long time;
    unsigned long long number;
    struct alarm *alarm;
};
struct timeline {
    PyObject_HEAD
    struct entry *due; /* a heap */
    size_t count, room;
    unsigned long long number;
};
extern PyTypeObject alarm_type, timeline_type;
struct alarm *add_alarm(struct timeline *timeline, long long time, PyObject *action);
long long next_alarm(struct timeline *timeline, long long end);
bool fire_alarms(struct timeline *timeline, long long now);
void clear_alarms(struct timeline *timeline);
bool get_alarm(PyObject *const *given, Py_ssize_t count, long long *time);

/* The state of all exceptions. */
#define MOST_EXCEPTIONS 128
#define FIRST_INTERRUPT 16
#define SVCALL 11
struct exceptions {
    PyObject_HEAD
    bits pending, enabled, lines;
    int priorities[MOST_EXCEPTIONS];
    uint8_t active[MOST_EXCEPTIONS]; /* those that have begun, the last one last */
    int actives, count, mask, group_bits;
};
extern PyTypeObject exceptions_type;
int running_priority(const struct exceptions *of);
int group_of(const struct exceptions *of, int priority);
int find_due(const struct exceptions *of, int ceiling);
void begin_exception(struct exceptions *of, int number);
void end_exception(struct exceptions *of);
bool hold_line(struct exceptions *of, int number, bool is_active);
bool get_line(PyObject *const *given, Py_ssize_t count, PyObject *names, int *number, bool *is_active);

/* Memory that may have instructions. */
#define MOST_REGIONS 8
struct region {
    uint64_t address, size;
    uint8_t *place;
    uint8_t *known; /* what is known of each instruction; NULL where they may change */
};

/* A core: its instructions are started, counted up to a limit, and looked at for the alignment of their accesses
 * (Armv7-M ARM, A3.2.1), which unicorn leaves out. One hook does both: unicorn calls a single one without detours. */
struct core {
    PyObject_HEAD
    void *engine;
    unsigned long long count, limit;
    struct region region[MOST_REGIONS];
    int regions;
    char traps_all;
    bool is_running, must_repeat, is_repeating;
    PyObject *kept; /* what its peripherals are of */
    struct timeline *timeline;
    struct exceptions *exceptions;
    long long epoch, done, per_ms; /* the time: epoch [ns] and instructions since */
    long long end;                 /* up to which it runs [ns] */
    uint32_t at;                   /* where it goes on */
    uint32_t reached;              /* the address of an access that is not aligned, or of the stack */
    uint32_t vectors;              /* the address of their table */
    int trap, number;
    int has_masks, has_floats;
    bool is_asleep, has_event, must_pause;
    char sleeps_on_exit;
};
extern PyTypeObject core_type;

static inline long long time_of(const struct core *of)
{
    wide done = of->done + (of->is_running ? (long long)of->count : 0);
    return of->epoch + (long long)(done * 1000000 / of->per_ms);
}

static inline struct region *region_of(struct core *of, uint32_t address, size_t size)
{
    for (struct region *each = of->region; each < of->region + of->regions; each++)
        if (address - each->address < each->size && size <= each->size - (address - each->address))
            return each;
    return NULL;
}

/* What is known of an instruction. */
enum { IS_KNOWN = 4, IS_PLAIN = 1, IS_ALWAYS_PLAIN = 2 /* where all accesses are to be aligned, too */ };

void take_trap(struct core *of, int number);
void look_at_alignment(struct core *of, uint32_t address, uint32_t size);
int fetch(struct core *of, uint32_t address, void *bytes, size_t size);
void read_some(struct core *of, int *numbers, uint32_t *values, int count);
void write_some(struct core *of, int *numbers, uint32_t *values, int count);
void look_for_exceptions(struct core *of);
void stop_behind_write(struct core *of);
int start_core(struct core *of, unsigned long long most);

/* Frames of exceptions; what they return is 0 or why it cannot go on. */
int enter_exception(struct core *of, int number);
int chain_exception(struct core *of, int number);
int leave_exception(struct core *of);

PyObject *map_range(PyObject *self, PyObject *arguments);
PyObject *live(PyObject *self, PyObject *until);

#endif
