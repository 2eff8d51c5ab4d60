/* A core: what it runs, and how far. */
#include "core.h"

#define NEVER 0xFFFFFFFEu /* an address that no program comes to */
#define HOOK_OF_TRAPS 1          /* UC_HOOK_INTR */
#define HOOK_OF_INSTRUCTIONS 4   /* UC_HOOK_CODE */
#define INVALID_INSTRUCTION 10   /* UC_ERR_INSN_INVALID */
#define WFI 0xBF30
#define WFE 0xBF20

void take_trap(struct core *of, int number)
{
    of->trap = number;
    uc_emu_stop(of->engine);
}

static void on_trap(void *engine, uint32_t number, void *data)
{
    (void)engine;
    take_trap(data, (int)number);
}

/* Reads memory; returns unicorn's error. */
int fetch(struct core *of, uint32_t address, void *bytes, size_t size)
{
    const struct region *region = region_of(of, address, size);
    if (region == NULL)
        return uc_mem_read(of->engine, address, bytes, size);
    memcpy(bytes, region->place + (address - region->address), size);
    return 0;
}

static void on_instruction(void *engine, uint64_t address, uint32_t size, void *data)
{
    struct core *of = data;
    if (++of->count > of->limit) {
        uc_emu_stop(engine);
        return;
    }
    const struct region *first = &of->region[0]; /* flash: as a rule it is there */
    uint64_t offset = address - first->address;
    if (offset >= first->size || first->known == NULL || !(first->known[offset / 2] & IS_PLAIN << of->traps_all))
        look_at_alignment(of, (uint32_t)address, size);
}

void read_some(struct core *of, int *numbers, uint32_t *values, int count)
{
    void *places[MOST_REGISTERS];
    for (int at = 0; at < count; at++)
        places[at] = &values[at];
    uc_reg_read_batch(of->engine, numbers, places, count);
}

void write_some(struct core *of, int *numbers, uint32_t *values, int count)
{
    void *places[MOST_REGISTERS];
    for (int at = 0; at < count; at++)
        places[at] = &values[at];
    uc_reg_write_batch(of->engine, numbers, places, count);
}

/* Runs. */

static int run(struct core *of, unsigned long long most)
{
    of->count = 0;
    of->limit = most;
    of->is_running = true;
    int error = uc_emu_start(of->engine, of->at | 1, NEVER, 0, 0);
    of->is_running = false;
    if (of->count > most) /* the one that it stops at is counted */
        of->count = most;
    of->done += (long long)of->count;
    read_some(of, (int[]){PC}, &of->at, 1);
    return error;
}

/* Does up to a number of instructions; returns why it ended, 0 for nothing to do. */
int start_core(struct core *of, unsigned long long most)
{
    of->trap = 0;
    int error = run(of, most);
    bool is_early = of->count < most, must_repeat = of->must_repeat;
    of->must_repeat = false;
    if (must_repeat && !error && !PyErr_Occurred()) {
        of->done--; /* counted already */
        of->is_repeating = true;
        error = run(of, 1);
        of->is_repeating = false;
    }
    if (of->trap)
        return of->trap;
    uint16_t code = 0;
    if (is_early || error)
        fetch(of, of->at - 2, &code, sizeof code);
    if (error)
        return error == INVALID_INSTRUCTION && code == WFE ? WAITS : ERRORS + error;
    return is_early && !must_repeat && code == WFI ? SLEEPS : 0;
}

/* Has a start return behind the write to a peripheral that it is in. */
void stop_behind_write(struct core *of)
{
    if (of->is_running && !of->is_repeating && !of->must_repeat) {
        of->must_repeat = true;
        uc_emu_stop(of->engine);
    }
}

void look_for_exceptions(struct core *of)
{
    if (of->exceptions->pending & of->exceptions->enabled)
        stop_behind_write(of);
}

/* For Python. */

static PyObject *look(PyObject *self, PyObject *none)
{
    (void)none;
    look_for_exceptions((struct core *)self);
    Py_RETURN_NONE;
}

static PyObject *pend(PyObject *self, PyObject *given)
{
    struct core *of = (struct core *)self;
    long number = PyLong_AsLong(given);
    if (PyErr_Occurred())
        return NULL;
    if (number >= 0 && number < of->exceptions->count)
        of->exceptions->pending |= (bits)1 << number;
    look_for_exceptions(of);
    Py_RETURN_NONE;
}

static PyObject *hold_interrupt(PyObject *self, PyObject *const *given, Py_ssize_t count, PyObject *names)
{
    struct core *of = (struct core *)self;
    int number;
    bool is_active;
    if (!get_line(given, count, names, &number, &is_active))
        return NULL;
    if (hold_line(of->exceptions, FIRST_INTERRUPT + number, is_active))
        look_for_exceptions(of);
    Py_RETURN_NONE;
}

static PyObject *alarm_at(PyObject *self, PyObject *const *given, Py_ssize_t count)
{
    struct core *of = (struct core *)self;
    long long time = 0;
    if (!get_alarm(given, count, &time))
        return NULL;
    struct alarm *alarm = add_alarm(of->timeline, time, given[1]);
    if (alarm != NULL && time < of->end)
        stop_behind_write(of);
    return (PyObject *)alarm;
}

static PyObject *wait_for_python(PyObject *self, PyObject *none)
{
    struct core *of = (struct core *)self;
    (void)none;
    of->must_pause = true;
    stop_behind_write(of);
    Py_RETURN_NONE;
}

static PyObject *wake(PyObject *self, PyObject *none)
{
    struct core *of = (struct core *)self;
    (void)none;
    if (!of->is_asleep)
        Py_RETURN_NONE;
    return PyLong_FromLongLong(next_alarm(of->timeline, 1LL << 62));
}

static PyObject *begin(PyObject *self, PyObject *at)
{
    struct core *of = (struct core *)self;
    of->epoch = time_of(of);
    of->done = 0;
    clear_alarms(of->timeline);
    of->is_asleep = of->has_event = of->must_pause = false;
    of->sleeps_on_exit = false;
    of->at = (uint32_t)PyLong_AsUnsignedLongMask(at) & ~1u;
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *trap(PyObject *self, PyObject *number)
{
    take_trap((struct core *)self, (int)PyLong_AsLong(number));
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *now(PyObject *self, PyObject *none)
{
    (void)none;
    return PyLong_FromLongLong(time_of((struct core *)self));
}

static PyObject *set_time(PyObject *self, PyObject *time)
{
    struct core *of = (struct core *)self;
    of->epoch = PyLong_AsLongLong(time);
    of->done = 0;
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *add_memory(PyObject *self, PyObject *arguments)
{
    struct core *of = (struct core *)self;
    struct region region = {.known = NULL};
    unsigned long long address, size, place;
    int is_fixed;
    if (!PyArg_ParseTuple(arguments, "KKKp", &address, &size, &place, &is_fixed))
        return NULL;
    if (of->regions == MOST_REGIONS)
        return PyErr_Format(PyExc_ValueError, "more than %d regions", MOST_REGIONS);
    region.address = address;
    region.size = size;
    region.place = (uint8_t *)(uintptr_t)place;
    if (is_fixed && (region.known = PyMem_Calloc(size / 2, 1)) == NULL)
        return PyErr_NoMemory();
    of->region[of->regions++] = region;
    Py_RETURN_NONE;
}

static int make_core(PyObject *self, PyObject *arguments, PyObject *keywords)
{
    struct core *of = (struct core *)self;
    PyObject *handle, *exceptions;
    if (keywords != NULL && PyDict_GET_SIZE(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Core(handle, per_ms, has_masks, has_floats, exceptions)");
        return -1;
    }
    if (!PyArg_ParseTuple(arguments, "OLppO!", &handle, &of->per_ms, &of->has_masks, &of->has_floats, &exceptions_type,
                          &exceptions))
        return -1;
    of->engine = PyLong_AsVoidPtr(handle);
    if (PyErr_Occurred())
        return -1;
    Py_XSETREF(of->kept, PyList_New(0));
    Py_XSETREF(of->timeline, (struct timeline *)PyObject_CallNoArgs((PyObject *)&timeline_type));
    Py_XSETREF(of->exceptions, (struct exceptions *)Py_NewRef(exceptions));
    if (of->kept == NULL || of->timeline == NULL)
        return -1;
    size_t hook;
    int error = uc_hook_add(of->engine, &hook, HOOK_OF_INSTRUCTIONS, (void *)on_instruction, of, 1, 0);
    if (!error)
        error = uc_hook_add(of->engine, &hook, HOOK_OF_TRAPS, (void *)on_trap, of, 1, 0);
    if (error)
        PyErr_Format(PyExc_RuntimeError, "unicorn's error %d", error);
    return error ? -1 : 0;
}

static int visit_core(PyObject *self, visitproc visit, void *arg)
{
    Py_VISIT(((struct core *)self)->kept);
    Py_VISIT(((struct core *)self)->timeline);
    Py_VISIT(((struct core *)self)->exceptions);
    return 0;
}

static int clear_core(PyObject *self)
{
    Py_CLEAR(((struct core *)self)->kept);
    Py_CLEAR(((struct core *)self)->timeline);
    Py_CLEAR(((struct core *)self)->exceptions);
    return 0;
}

static void end_core(PyObject *self)
{
    struct core *of = (struct core *)self;
    PyObject_GC_UnTrack(self);
    clear_core(self);
    for (int at = 0; at < of->regions; at++)
        PyMem_Free(of->region[at].known);
    Py_TYPE(self)->tp_free(self);
}

static PyMethodDef core_methods[] = {
    {"live", live, METH_O, NULL},
    {"pause", wait_for_python, METH_NOARGS, NULL},
    {"look", look, METH_NOARGS, NULL},
    {"pend", pend, METH_O, NULL},
    {"hold_line", (PyCFunction)(void (*)(void))hold_interrupt, METH_FASTCALL | METH_KEYWORDS, NULL},
    {"alarm", (PyCFunction)(void (*)(void))alarm_at, METH_FASTCALL, NULL},
    {"trap", trap, METH_O, NULL},
    {"now", now, METH_NOARGS, NULL},
    {"wake", wake, METH_NOARGS, NULL},
    {"set_time", set_time, METH_O, NULL},
    {"begin", begin, METH_O, NULL},
    {"map", map_range, METH_VARARGS, NULL},
    {"add_memory", add_memory, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef core_members[] = {
    {"at", T_UINT, offsetof(struct core, at), READONLY, NULL},
    {"reached", T_UINT, offsetof(struct core, reached), READONLY, NULL},
    {"number", T_INT, offsetof(struct core, number), READONLY, NULL},
    {"vectors", T_UINT, offsetof(struct core, vectors), 0, NULL},
    {"sleeps_on_exit", T_BOOL, offsetof(struct core, sleeps_on_exit), 0, NULL},
    {"traps_all", T_BOOL, offsetof(struct core, traps_all), 0, NULL},
    {NULL, 0, 0, 0, NULL},
};

PyTypeObject core_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Core",
    .tp_doc = "Core(handle, per_ms, has_masks, has_floats, exceptions)\n\nA core; see calls.py.",
    .tp_basicsize = sizeof(struct core),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC,
    .tp_new = PyType_GenericNew,
    .tp_init = make_core,
    .tp_dealloc = end_core,
    .tp_traverse = visit_core,
    .tp_clear = clear_core,
    .tp_methods = core_methods,
    .tp_members = core_members,
};
