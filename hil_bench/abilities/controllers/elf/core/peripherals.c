/* Registers of peripherals: some need no model to answer. */
#include "core.h"

/* A range of registers: `kinds` says of each which accesses need no model. */
#define IS_READ 1    /* it reads as its word */
#define IS_WRITTEN 2 /* its word keeps what is written */
#define IS_COUNTED 4 /* it reads as the ramp: counts since a time, up to a most, where it counts */
#define IS_KEPT 8    /* a write of what its word is changes nothing */
struct range {
    struct core *core;
    PyObject *read, *write; /* the model's functions */
    uint32_t *words;
    const uint8_t *kinds;
    const int64_t *ramp; /* begin [ns], counts of so many ns by two numbers, the most; 0 ns where it stands */
    uint64_t size;       /* of the registers that have words */
};

/* Calls a function of Python's and takes the reference to each argument, NULL for one that could not
 * be made. An exception stays set: it stops the engine, and its start raises it. */
static PyObject *call(void *engine, PyObject *function, PyObject **arguments, size_t count)
{
    PyObject *result = NULL;
    bool are_made = !PyErr_Occurred();
    for (size_t at = 0; at < count; at++)
        are_made = are_made && arguments[at] != NULL;
    if (are_made)
        result = PyObject_Vectorcall(function, arguments, count, NULL);
    for (size_t at = 0; at < count; at++)
        Py_XDECREF(arguments[at]);
    if (result == NULL)
        uc_emu_stop(engine);
    return result;
}

static uint64_t on_read(void *engine, uint64_t offset, unsigned size, void *data)
{
    struct range *range = data;
    if (offset < range->size) {
        uint8_t kind = range->kinds[offset / 4];
        uint32_t word = range->words[offset / 4];
        if (kind & IS_COUNTED && range->ramp[2] != 0) {
            wide count = (wide)(time_of(range->core) - range->ramp[0]) * range->ramp[1] / range->ramp[2];
            word = (uint32_t)(count < 0 ? 0 : count < range->ramp[3] ? count : range->ramp[3]);
        }
        if (kind & (IS_READ | IS_COUNTED))
            return word >> (offset & 3) * 8 & 0xFFFFFFFFu >> (32 - 8 * size);
    }
    if (PyErr_Occurred())
        return 0;
    PyObject *arguments[] = {PyLong_FromUnsignedLongLong(offset), PyLong_FromUnsignedLong(size)};
    PyObject *result = call(engine, range->read, arguments, 2);
    uint64_t value = result != NULL ? PyLong_AsUnsignedLongLongMask(result) : 0;
    Py_XDECREF(result);
    if (result != NULL && PyErr_Occurred())
        uc_emu_stop(engine);
    return value;
}

static void on_write(void *engine, uint64_t offset, unsigned size, uint64_t value, void *data)
{
    struct range *range = data;
    if (range->core->is_repeating || PyErr_Occurred())
        return;
    if (size == 4 && offset < range->size) {
        uint8_t kind = range->kinds[offset / 4];
        uint32_t *word = &range->words[offset / 4];
        if (kind & IS_KEPT && *word == (uint32_t)value)
            return;
        if (kind & IS_WRITTEN) {
            *word = (uint32_t)value;
            return;
        }
    }
    PyObject *arguments[] = {
        PyLong_FromUnsignedLongLong(offset), PyLong_FromUnsignedLong(size), PyLong_FromUnsignedLongLong(value)};
    Py_XDECREF(call(engine, range->write, arguments, 3));
}

/* Returns the bytes of an object that is kept with them, NULL where it has too few. */
static void *bytes_of(PyObject *object, Py_ssize_t least)
{
    Py_buffer buffer;
    if (PyObject_GetBuffer(object, &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    void *bytes = buffer.buf;
    if (buffer.len < least) {
        PyErr_Format(PyExc_ValueError, "%zd bytes, not %zd", buffer.len, least);
        bytes = NULL;
    }
    PyBuffer_Release(&buffer);
    return bytes;
}

PyObject *map_range(PyObject *self, PyObject *arguments)
{
    struct core *of = (struct core *)self;
    unsigned long long address;
    Py_ssize_t size, words = 0;
    PyObject *read, *write, *cells;
    if (!PyArg_ParseTuple(arguments, "KnOOO", &address, &size, &read, &write, &cells))
        return NULL;
    struct range range = {.core = of, .read = read, .write = write};
    if (cells != Py_None) {
        PyObject *values, *kinds, *ramp;
        if (!PyArg_Parse(cells, "(OOO)", &values, &kinds, &ramp) || (words = PyObject_Size(kinds)) < 0)
            return NULL;
        range.size = 4 * (uint64_t)words;
        range.words = bytes_of(values, 4 * words);
        range.kinds = bytes_of(kinds, words);
        range.ramp = bytes_of(ramp, 4 * (Py_ssize_t)sizeof *range.ramp);
        if (PyErr_Occurred())
            return NULL;
    }
    PyObject *held = PyBytes_FromStringAndSize((const char *)&range, sizeof range);
    int is_kept = held == NULL ? -1 : PyList_Append(of->kept, held) | PyList_Append(of->kept, arguments);
    Py_XDECREF(held);
    if (is_kept < 0)
        return NULL;
    void *data = PyBytes_AS_STRING(held);
    return PyLong_FromLong(uc_mmio_map(of->engine, address, (size_t)size, on_read, data, on_write, data));
}
