/* The time of a chip: what is due when. */
#include "core.h"

static bool is_before(const struct entry *one, const struct entry *other)
{
    return one->time < other->time || (one->time == other->time && one->number < other->number);
}

/* Takes the first one away, whose reference is the caller's then. */
static struct alarm *take_first(struct timeline *of)
{
    struct alarm *first = of->due[0].alarm;
    struct entry last = of->due[--of->count];
    size_t at = 0, child;
    while ((child = 2 * at + 1) < of->count) {
        if (child + 1 < of->count && is_before(&of->due[child + 1], &of->due[child]))
            child++;
        if (!is_before(&of->due[child], &last))
            break;
        of->due[at] = of->due[child];
        at = child;
    }
    of->due[at] = last;
    return first;
}

/* Returns a new reference; NULL where there is no room. */
struct alarm *add_alarm(struct timeline *of, long long time, PyObject *action)
{
    if (of->count == of->room) {
        size_t room = of->room ? 2 * of->room : 32;
        struct entry *due = PyMem_Realloc(of->due, room * sizeof *due);
        if (due == NULL)
            return (struct alarm *)PyErr_NoMemory();
        of->due = due, of->room = room;
    }
    struct alarm *alarm = PyObject_GC_New(struct alarm, &alarm_type);
    if (alarm == NULL)
        return NULL;
    alarm->time = time, alarm->action = Py_NewRef(action), alarm->is_on = true;
    PyObject_GC_Track(alarm);
    struct entry entry = {time, of->number++, (struct alarm *)Py_NewRef(alarm)};
    size_t at = of->count++;
    while (at > 0 && is_before(&entry, &of->due[(at - 1) / 2])) {
        of->due[at] = of->due[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    of->due[at] = entry;
    return alarm;
}

/* Returns the time of what is due next, at most `end`. */
long long next_alarm(struct timeline *of, long long end)
{
    while (of->count && !of->due[0].alarm->is_on)
        Py_DECREF(take_first(of));
    return of->count && of->due[0].time < end ? of->due[0].time : end;
}

/* Does what is due by now; false with an exception. */
bool fire_alarms(struct timeline *of, long long now)
{
    while (of->count && of->due[0].time <= now) {
        struct alarm *alarm = take_first(of);
        PyObject *result = Py_None;
        if (alarm->is_on) {
            alarm->is_on = false;
            result = PyObject_CallNoArgs(alarm->action);
            Py_XDECREF(result);
        }
        Py_DECREF(alarm);
        if (result == NULL)
            return false;
    }
    return true;
}

void clear_alarms(struct timeline *of)
{
    while (of->count)
        Py_DECREF(of->due[--of->count].alarm);
}

/* Reads time and action; false with an exception where they are not there. */
bool get_alarm(PyObject *const *given, Py_ssize_t count, long long *time)
{
    if (count == 2)
        *time = PyLong_AsLongLong(given[0]);
    else
        PyErr_SetString(PyExc_TypeError, "time and action");
    return !PyErr_Occurred();
}

/* For Python. */

static PyObject *cancel(PyObject *self, PyObject *none)
{
    (void)none;
    ((struct alarm *)self)->is_on = false;
    Py_RETURN_NONE;
}

static int visit_alarm(PyObject *self, visitproc visit, void *arg)
{
    Py_VISIT(((struct alarm *)self)->action);
    return 0;
}

static int clear_action(PyObject *self)
{
    Py_CLEAR(((struct alarm *)self)->action);
    return 0;
}

static void end_alarm(PyObject *self)
{
    PyObject_GC_UnTrack(self);
    clear_action(self);
    PyObject_GC_Del(self);
}

static PyMethodDef alarm_methods[] = {
    {"cancel", cancel, METH_NOARGS, "Have nothing happen then."},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef alarm_members[] = {
    {"time", T_LONGLONG, offsetof(struct alarm, time), READONLY, "When [ns]."},
    {"is_on", T_BOOL, offsetof(struct alarm, is_on), READONLY, "False once it was cancelled or is over."},
    {NULL, 0, 0, 0, NULL},
};

PyTypeObject alarm_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Alarm",
    .tp_doc = "Something that is due at a time, unless it is cancelled.",
    .tp_basicsize = sizeof(struct alarm),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_DISALLOW_INSTANTIATION,
    .tp_dealloc = end_alarm,
    .tp_traverse = visit_alarm,
    .tp_clear = clear_action,
    .tp_methods = alarm_methods,
    .tp_members = alarm_members,
};

static PyObject *add(PyObject *self, PyObject *const *given, Py_ssize_t count)
{
    long long time = 0;
    if (!get_alarm(given, count, &time))
        return NULL;
    return (PyObject *)add_alarm((struct timeline *)self, time, given[1]);
}

static PyObject *next_time(PyObject *self, PyObject *end)
{
    long long most = PyLong_AsLongLong(end);
    return PyErr_Occurred() ? NULL : PyLong_FromLongLong(next_alarm((struct timeline *)self, most));
}

static PyObject *fire(PyObject *self, PyObject *now)
{
    long long time = PyLong_AsLongLong(now);
    if (PyErr_Occurred() || !fire_alarms((struct timeline *)self, time))
        return NULL;
    Py_RETURN_NONE;
}

static int visit_timeline(PyObject *self, visitproc visit, void *arg)
{
    const struct timeline *of = (struct timeline *)self;
    for (size_t at = 0; at < of->count; at++)
        Py_VISIT(of->due[at].alarm);
    return 0;
}

static int clear_timeline(PyObject *self)
{
    clear_alarms((struct timeline *)self);
    return 0;
}

static void end_timeline(PyObject *self)
{
    PyObject_GC_UnTrack(self);
    clear_timeline(self);
    PyMem_Free(((struct timeline *)self)->due);
    Py_TYPE(self)->tp_free(self);
}

static PyMethodDef timeline_methods[] = {
    {"add", (PyCFunction)(void (*)(void))add, METH_FASTCALL, "add(time, action) -> alarm\n\n"
                                                             "Have something happen at a time [ns]."},
    {"next_time", next_time, METH_O, "next_time(end) -> time\n\nReturn the time of what is due next [ns], at most end."},
    {"fire", fire, METH_O, "fire(now)\n\nDo what is due by now [ns]."},
    {NULL, NULL, 0, NULL},
};

PyTypeObject timeline_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Timeline",
    .tp_doc = "All that is due, in order of time.",
    .tp_basicsize = sizeof(struct timeline),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC,
    .tp_new = PyType_GenericNew,
    .tp_dealloc = end_timeline,
    .tp_traverse = visit_timeline,
    .tp_clear = clear_timeline,
    .tp_methods = timeline_methods,
};
