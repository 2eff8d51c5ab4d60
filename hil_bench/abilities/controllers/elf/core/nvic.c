/* Exceptions of a Cortex-M: pending, enabled, active, and which comes first (Armv7-M ARM, B1.5). */
#include "core.h"

#define THREAD_PRIORITY 256 /* of code outside of exceptions: any exception is more urgent */
#define BIT(number) ((bits)1 << (number))
enum { RESET = 1, NMI = 2, HARD_FAULT = 3, PENDSV = 14, SYSTICK = 15 };

/* Returns the part of a priority that preempts. */
int group_of(const struct exceptions *of, int priority)
{
    return priority < 0 ? priority : priority >> of->group_bits << of->group_bits;
}

/* Returns the priority at which code runs now, masks left aside. */
int running_priority(const struct exceptions *of)
{
    int least = THREAD_PRIORITY;
    for (int at = 0; at < of->actives; at++) {
        int group = group_of(of, of->priorities[of->active[at]]);
        least = group < least ? group : least;
    }
    return least;
}

static int lowest(bits waiting)
{
    uint64_t low = (uint64_t)waiting;
    return low ? __builtin_ctzll(low) : 64 + __builtin_ctzll((uint64_t)(waiting >> 64));
}

/* Returns the exception that preempts what runs at a priority, 0 for none. */
int find_due(const struct exceptions *of, int ceiling)
{
    int best = 0, urgency = ceiling;
    for (bits waiting = of->pending & of->enabled; waiting; waiting &= waiting - 1) {
        int number = lowest(waiting);
        int group = group_of(of, of->priorities[number]);
        if (group < urgency || (best && group == urgency && of->priorities[number] < of->priorities[best])) {
            best = number;
            urgency = group;
        }
    }
    return best;
}

void begin_exception(struct exceptions *of, int number)
{
    of->pending &= ~BIT(number);
    of->active[of->actives++] = (uint8_t)number;
}

/* Ends the last one; one whose line is still active comes again. */
void end_exception(struct exceptions *of)
{
    of->pending |= of->lines & BIT(of->active[--of->actives]);
}

/* Sets the level of the line of an exception; returns whether it is active. */
bool hold_line(struct exceptions *of, int number, bool is_active)
{
    if (number < 0 || number >= of->count)
        return false;
    if (!is_active)
        of->lines &= ~BIT(number);
    else if (!(of->lines & BIT(number))) {
        of->lines |= BIT(number);
        of->pending |= BIT(number);
    }
    return is_active;
}

/* Reads a number and `is_active`; false with an exception where they are not there. */
bool get_line(PyObject *const *given, Py_ssize_t count, PyObject *names, int *number, bool *is_active)
{
    if (count != 1 || names == NULL || PyTuple_GET_SIZE(names) != 1) {
        PyErr_SetString(PyExc_TypeError, "number, is_active=");
        return false;
    }
    *number = (int)PyLong_AsLong(given[0]);
    *is_active = PyObject_IsTrue(given[1]) > 0;
    return !PyErr_Occurred();
}

/* For Python. */

static void begin_anew(struct exceptions *of)
{
    of->pending = of->lines = 0;
    of->enabled = BIT(NMI) | BIT(HARD_FAULT) | BIT(SVCALL) | BIT(PENDSV) | BIT(SYSTICK);
    of->actives = 0;
    of->group_bits = 1;
    memset(of->priorities, 0, sizeof of->priorities);
    for (int number = RESET; number <= HARD_FAULT; number++)
        of->priorities[number] = number - HARD_FAULT - 1;
}

static int make_exceptions(PyObject *self, PyObject *arguments, PyObject *keywords)
{
    struct exceptions *of = (struct exceptions *)self;
    int priority_bits, interrupts;
    if (keywords != NULL && PyDict_GET_SIZE(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Exceptions(priority_bits, interrupts)");
        return -1;
    }
    if (!PyArg_ParseTuple(arguments, "ii", &priority_bits, &interrupts))
        return -1;
    if (priority_bits < 0 || priority_bits > 8 || interrupts < 0 || interrupts > MOST_EXCEPTIONS - FIRST_INTERRUPT) {
        PyErr_Format(PyExc_ValueError, "0 to 8 bits, 0 to %d interrupts", MOST_EXCEPTIONS - FIRST_INTERRUPT);
        return -1;
    }
    of->mask = 0xFF00 >> priority_bits & 0xFF;
    of->count = FIRST_INTERRUPT + interrupts;
    begin_anew(of);
    return 0;
}

static PyObject *reset(PyObject *self, PyObject *none)
{
    (void)none;
    begin_anew((struct exceptions *)self);
    Py_RETURN_NONE;
}

static bool get_number(const struct exceptions *of, PyObject *given, int *number)
{
    *number = (int)PyLong_AsLong(given);
    if (!PyErr_Occurred() && (*number < 0 || *number >= of->count))
        PyErr_Format(PyExc_ValueError, "exception %d of %d", *number, of->count);
    return !PyErr_Occurred();
}

static PyObject *set_priority(PyObject *self, PyObject *arguments)
{
    struct exceptions *of = (struct exceptions *)self;
    int number, value;
    if (!PyArg_ParseTuple(arguments, "ii", &number, &value))
        return NULL;
    if (number > HARD_FAULT && number < of->count)
        of->priorities[number] = value & of->mask;
    Py_RETURN_NONE;
}

static PyObject *find(PyObject *self, PyObject *ceiling)
{
    long most = PyLong_AsLong(ceiling);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(find_due((struct exceptions *)self, (int)most));
}

static PyObject *begin(PyObject *self, PyObject *given)
{
    struct exceptions *of = (struct exceptions *)self;
    int number;
    if (!get_number(of, given, &number))
        return NULL;
    if (of->actives == MOST_EXCEPTIONS)
        return PyErr_Format(PyExc_IndexError, "%d exceptions are active", of->actives);
    begin_exception(of, number);
    Py_RETURN_NONE;
}

static PyObject *end(PyObject *self, PyObject *none)
{
    struct exceptions *of = (struct exceptions *)self;
    (void)none;
    if (of->actives == 0)
        return PyErr_Format(PyExc_IndexError, "no exception is active");
    end_exception(of);
    Py_RETURN_NONE;
}

static PyObject *hold(PyObject *self, PyObject *const *given, Py_ssize_t count, PyObject *names)
{
    int number;
    bool is_active;
    if (!get_line(given, count, names, &number, &is_active))
        return NULL;
    hold_line((struct exceptions *)self, number, is_active);
    Py_RETURN_NONE;
}

static PyObject *number_of_bits(bits value)
{
    uint64_t halves[2] = {(uint64_t)value, (uint64_t)(value >> 64)};
    return _PyLong_FromByteArray((const unsigned char *)halves, sizeof halves, 1, 0);
}

static PyObject *get_bits(PyObject *self, void *offset)
{
    return number_of_bits(*(bits *)((char *)self + (size_t)offset));
}

static int set_bits(PyObject *self, PyObject *value, void *offset)
{
    PyObject *places = PyLong_FromLong(64), *high = NULL;
    if (places != NULL && value != NULL)
        high = PyNumber_Rshift(value, places);
    Py_XDECREF(places);
    if (high == NULL)
        return -1;
    bits *to = (bits *)((char *)self + (size_t)offset);
    *to = (bits)PyLong_AsUnsignedLongLongMask(high) << 64 | PyLong_AsUnsignedLongLongMask(value);
    Py_DECREF(high);
    return PyErr_Occurred() ? -1 : 0;
}

static PyObject *list_of(Py_ssize_t count, const struct exceptions *of, bool are_active)
{
    PyObject *list = PyList_New(count);
    for (Py_ssize_t at = 0; list != NULL && at < count; at++) {
        PyObject *each = PyLong_FromLong(are_active ? of->active[at] : of->priorities[at]);
        if (each == NULL)
            Py_CLEAR(list);
        else
            PyList_SET_ITEM(list, at, each);
    }
    return list;
}

static PyObject *get_active(PyObject *self, void *none)
{
    const struct exceptions *of = (struct exceptions *)self;
    (void)none;
    return list_of(of->actives, of, true);
}

static PyObject *get_priorities(PyObject *self, void *none)
{
    const struct exceptions *of = (struct exceptions *)self;
    (void)none;
    return list_of(of->count, of, false);
}

static PyObject *get_priority(PyObject *self, void *none)
{
    (void)none;
    return PyLong_FromLong(running_priority((struct exceptions *)self));
}

#define BITS(name) {#name, get_bits, set_bits, NULL, (void *)offsetof(struct exceptions, name)}
static PyGetSetDef exceptions_values[] = {
    BITS(pending),
    BITS(enabled),
    BITS(lines),
    {"active", get_active, NULL, NULL, NULL},
    {"priorities", get_priorities, NULL, NULL, NULL},
    {"priority", get_priority, NULL, NULL, NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyMemberDef exceptions_members[] = {
    {"count", T_INT, offsetof(struct exceptions, count), READONLY, NULL},
    {"group_bits", T_INT, offsetof(struct exceptions, group_bits), 0, NULL},
    {NULL, 0, 0, 0, NULL},
};

static PyMethodDef exceptions_methods[] = {
    {"reset", reset, METH_NOARGS, NULL},
    {"set_priority", set_priority, METH_VARARGS, NULL},
    {"find_due", find, METH_O, NULL},
    {"begin", begin, METH_O, NULL},
    {"end", end, METH_NOARGS, NULL},
    {"hold_line", (PyCFunction)(void (*)(void))hold, METH_FASTCALL | METH_KEYWORDS, NULL},
    {NULL, NULL, 0, NULL},
};

PyTypeObject exceptions_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Exceptions",
    .tp_doc = "Exceptions(priority_bits, interrupts)\n\nThe state of all exceptions; see calls.py.",
    .tp_basicsize = sizeof(struct exceptions),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = PyType_GenericNew,
    .tp_init = make_exceptions,
    .tp_methods = exceptions_methods,
    .tp_members = exceptions_members,
    .tp_getset = exceptions_values,
};
