/* The life of a core from event to event: alarms, exceptions, instructions, sleep. */
#include "core.h"

#define MASKED_STEP 16 /* instructions after which the masks are looked at, where they alone hold an exception back */

/* Returns the priority that an exception has to be below, by a priority and the masks. */
static int ceiling_of(struct core *of, int ceiling)
{
    uint32_t masks[3] = {0, 0, 0};
    read_some(of, (int[]){PRIMASK, BASEPRI, FAULTMASK}, masks, of->has_masks ? 3 : 1);
    if (masks[0] & 1 && ceiling > 0)
        ceiling = 0;
    int base = group_of(of->exceptions, (int)masks[1]);
    if (masks[1] && base < ceiling)
        ceiling = base;
    return masks[2] & 1 && ceiling > -1 ? -1 : ceiling;
}

/* Enters the exception that is due; `step` becomes a number of instructions to look again after. */
static int preempt(struct core *of, unsigned *step)
{
    int priority = running_priority(of->exceptions);
    int number = find_due(of->exceptions, priority);
    if (!number)
        return 0;
    of->is_asleep = false;
    int ceiling = ceiling_of(of, priority);
    if (ceiling < priority && !(number = find_due(of->exceptions, ceiling))) {
        *step = MASKED_STEP;
        return 0;
    }
    return enter_exception(of, number);
}

/* Ends the exception that runs: enters the next one, or goes back to what it interrupted. */
static int leave(struct core *of)
{
    struct exceptions *exceptions = of->exceptions;
    if (!exceptions->actives)
        return NO_EXCEPTION;
    end_exception(exceptions);
    uint32_t faultmask = 0;
    if (of->has_masks)
        read_some(of, (int[]){FAULTMASK}, &faultmask, 1);
    if (faultmask)
        write_some(of, (int[]){FAULTMASK}, (uint32_t[]){0}, 1);
    of->has_event = true;
    if (exceptions->pending & exceptions->enabled) {
        int number = find_due(exceptions, ceiling_of(of, running_priority(exceptions)));
        if (number)
            return chain_exception(of, number);
    }
    int why = leave_exception(of);
    if (!why && of->sleeps_on_exit && !exceptions->actives)
        of->is_asleep = true;
    return why;
}

/* Runs until `end`, or fewer instructions where `step` is not 0; returns 0 or why it cannot go on. */
static int execute(struct core *of, long long now, long long end, unsigned step)
{
    unsigned long long count = (unsigned long long)(((wide)(end - now) * of->per_ms + 999999) / 1000000);
    if (step && step < count)
        count = step;
    of->end = end;
    int why = start_core(of, count ? count : 1);
    switch (why) {
    case SLEEPS:
        of->is_asleep = true;
        return 0;
    case WAITS:
        of->is_asleep = !of->has_event;
        of->has_event = false;
        return 0;
    case TRAP_RETURN:
        return leave(of);
    case TRAP_CALL:
        return enter_exception(of, SVCALL);
    default:
        return why;
    }
}

/* Lives until a moment; returns 0 or why it cannot, NULL with an exception. */
PyObject *live(PyObject *self, PyObject *given)
{
    struct core *of = (struct core *)self;
    long long until = PyLong_AsLongLong(given);
    int why = 0;
    while (!why && !PyErr_Occurred()) {
        long long now = time_of(of);
        unsigned step = 0;
        if (!fire_alarms(of->timeline, now))
            break;
        if (of->must_pause) {
            of->must_pause = false;
            why = PAUSES;
            break;
        }
        if (of->exceptions->pending & of->exceptions->enabled && (why = preempt(of, &step)))
            break;
        if (now >= until || PyErr_Occurred())
            break;
        long long end = next_alarm(of->timeline, until);
        if (of->is_asleep)
            of->epoch = end, of->done = 0;
        else
            why = execute(of, now, end, step);
    }
    return PyErr_Occurred() ? NULL : PyLong_FromLong(why);
}
