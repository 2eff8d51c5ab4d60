/* One call of a controller's library a tick: frames packed, the library called, its answer returned.
 *
 * controller.py does the same by ctypes where this is not built; that takes five times as long.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <string.h>

#include "include/hil_controller.h"

#define MOST_FRAMES 256

typedef int (*advance_function)(struct hil_controller *, int64_t, const struct hil_frame *, size_t,
                                struct hil_frame *, size_t, size_t *);

/* Packs (time, (identifier, data, is_remote, is_extended, bus, 0)); returns -1 with an exception. */
static int pack(PyObject *timed, struct hil_frame *frame)
{
    PyObject *fields = PyTuple_Check(timed) && PyTuple_GET_SIZE(timed) == 2 ? PyTuple_GET_ITEM(timed, 1) : NULL;
    if (fields == NULL || !PyTuple_Check(fields) || PyTuple_GET_SIZE(fields) != 6
        || !PyBytes_Check(PyTuple_GET_ITEM(fields, 1)) || PyBytes_GET_SIZE(PyTuple_GET_ITEM(fields, 1)) > 8) {
        PyErr_SetString(PyExc_TypeError, "no frame with its time");
        return -1;
    }
    PyObject *data = PyTuple_GET_ITEM(fields, 1);
    memset(frame, 0, sizeof *frame);
    frame->time_ns = PyLong_AsLongLong(PyTuple_GET_ITEM(timed, 0));
    frame->id = (uint32_t)PyLong_AsUnsignedLong(PyTuple_GET_ITEM(fields, 0));
    frame->bus = (uint8_t)PyLong_AsUnsignedLong(PyTuple_GET_ITEM(fields, 4));
    frame->length = (uint8_t)PyBytes_GET_SIZE(data);
    frame->flags = (PyTuple_GET_ITEM(fields, 3) == Py_True ? HIL_EXTENDED : 0)
                   | (PyTuple_GET_ITEM(fields, 2) == Py_True ? HIL_REMOTE : 0);
    memcpy(frame->data, PyBytes_AS_STRING(data), frame->length);
    return PyErr_Occurred() ? -1 : 0;
}

PyDoc_STRVAR(advance_doc,
             "advance(function, instance, until, received, sent) -> (state, count)\n\n"
             "Call hil_controller_advance, given by the address of the function and of the instance,\n"
             "with received frames; those that it sends are written to the bytearray `sent`.");

static PyObject *advance(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (count != 5 || !PyList_Check(given[3]) || !PyByteArray_Check(given[4])
        || PyList_GET_SIZE(given[3]) > MOST_FRAMES) {
        PyErr_SetString(PyExc_TypeError, "advance(function, instance, until, list, bytearray)");
        return NULL;
    }
    advance_function call = (advance_function)PyLong_AsVoidPtr(given[0]);
    struct hil_controller *instance = PyLong_AsVoidPtr(given[1]);
    long long until = PyLong_AsLongLong(given[2]);
    if (PyErr_Occurred())
        return NULL;
    struct hil_frame received[MOST_FRAMES];
    size_t received_count = (size_t)PyList_GET_SIZE(given[3]), sent_count = 0;
    for (size_t at = 0; at < received_count; at++)
        if (pack(PyList_GET_ITEM(given[3], (Py_ssize_t)at), &received[at]) < 0)
            return NULL;
    struct hil_frame *sent = (struct hil_frame *)PyByteArray_AS_STRING(given[4]);
    size_t room = (size_t)PyByteArray_GET_SIZE(given[4]) / sizeof *sent;
    int state;
    Py_BEGIN_ALLOW_THREADS
    state = call(instance, until, received, received_count, sent, room, &sent_count);
    Py_END_ALLOW_THREADS
    return Py_BuildValue("in", state, (Py_ssize_t)(sent_count > PY_SSIZE_T_MAX ? PY_SSIZE_T_MAX : sent_count));
}

static PyMethodDef methods[] = {
    {"advance", (PyCFunction)(void (*)(void))advance, METH_FASTCALL, advance_doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_call", "Calls of a controller's library.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__call(void)
{
    return PyModule_Create(&definition);
}
