/* One call of a controller's library a tick: frames packed, the library called, its answer returned.
 *
 * controller.py does the same by ctypes where this is not built; that takes five times as long.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdbool.h>
#include <string.h>

#include "include/hil_controller.h"

#define MOST_FRAMES 256

typedef int (*advance_function)(struct hil_controller *, int64_t, const struct hil_frame *, size_t,
                                struct hil_frame *, size_t, size_t *);

static bool is_tuple_type(PyObject *given)
{
    return PyType_Check(given) && PyType_IsSubtype((PyTypeObject *)given, &PyTuple_Type);
}

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

/* Returns a frame with its time, of two types that are tuples; NULL with an exception. */
static PyObject *unpack(const struct hil_frame *sent, PyTypeObject *timed_type, PyTypeObject *frame_type)
{
    PyObject *frame = frame_type->tp_alloc(frame_type, 6);
    if (frame == NULL)
        return NULL;
    bool is_remote = sent->flags & HIL_REMOTE;
    PyTuple_SET_ITEM(frame, 0, PyLong_FromUnsignedLong(sent->id));
    PyTuple_SET_ITEM(frame, 1, PyBytes_FromStringAndSize((const char *)sent->data, is_remote ? 0 : sent->length));
    PyTuple_SET_ITEM(frame, 2, PyBool_FromLong(is_remote));
    PyTuple_SET_ITEM(frame, 3, PyBool_FromLong(sent->flags & HIL_EXTENDED));
    PyTuple_SET_ITEM(frame, 4, PyLong_FromUnsignedLong(sent->bus));
    PyTuple_SET_ITEM(frame, 5, PyLong_FromLong(0));
    PyObject *timed = PyErr_Occurred() ? NULL : timed_type->tp_alloc(timed_type, 2);
    if (timed == NULL) {
        Py_DECREF(frame);
        return NULL;
    }
    PyTuple_SET_ITEM(timed, 1, frame);
    PyTuple_SET_ITEM(timed, 0, PyLong_FromLongLong(sent->time_ns));
    if (PyErr_Occurred())
        Py_CLEAR(timed);
    return timed;
}

/* Returns a list of all frames, or None where one cannot be; NULL with an exception. */
static PyObject *unpack_all(const struct hil_frame *sent, Py_ssize_t count, int64_t until, PyTypeObject *timed_type,
                            PyTypeObject *frame_type)
{
    for (Py_ssize_t at = 0; at < count; at++)
        if (sent[at].length > 8 || sent[at].flags > (HIL_EXTENDED | HIL_REMOTE) || sent[at].time_ns > until
            || sent[at].id >> (sent[at].flags & HIL_EXTENDED ? 29 : 11))
            Py_RETURN_NONE;
    PyObject *all = PyList_New(count);
    for (Py_ssize_t at = 0; all != NULL && at < count; at++) {
        PyObject *timed = unpack(&sent[at], timed_type, frame_type);
        PyList_SET_ITEM(all, at, timed);
        if (timed == NULL)
            Py_CLEAR(all);
    }
    return all;
}

PyDoc_STRVAR(advance_doc,
             "advance(function, instance, until, received, sent, timed, frame) -> (state, count, frames)\n\n"
             "Call hil_controller_advance, given by the address of the function and of the instance,\n"
             "with received frames; those that it sends are written to the bytearray `sent`, and returned\n"
             "as tuples of the types `timed` and `frame`; None where one of them cannot be.");

static PyObject *advance(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (count != 7 || !(PyList_Check(given[3]) || PyTuple_Check(given[3])) || !PyByteArray_Check(given[4])
        || PySequence_Fast_GET_SIZE(given[3]) > MOST_FRAMES || !is_tuple_type(given[5]) || !is_tuple_type(given[6])) {
        PyErr_SetString(PyExc_TypeError, "advance(function, instance, until, list or tuple, bytearray, type, type)");
        return NULL;
    }
    advance_function call = (advance_function)PyLong_AsVoidPtr(given[0]);
    struct hil_controller *instance = PyLong_AsVoidPtr(given[1]);
    long long until = PyLong_AsLongLong(given[2]);
    if (PyErr_Occurred())
        return NULL;
    struct hil_frame received[MOST_FRAMES];
    size_t received_count = (size_t)PySequence_Fast_GET_SIZE(given[3]), sent_count = 0;
    for (size_t at = 0; at < received_count; at++)
        if (pack(PySequence_Fast_GET_ITEM(given[3], (Py_ssize_t)at), &received[at]) < 0)
            return NULL;
    struct hil_frame *sent = (struct hil_frame *)PyByteArray_AS_STRING(given[4]);
    size_t room = (size_t)PyByteArray_GET_SIZE(given[4]) / sizeof *sent;
    int state;
    Py_BEGIN_ALLOW_THREADS
    state = call(instance, until, received, received_count, sent, room, &sent_count);
    Py_END_ALLOW_THREADS
    PyObject *frames = sent_count > room ? Py_NewRef(Py_None)
                                         : unpack_all(sent, (Py_ssize_t)sent_count, until,
                                                      (PyTypeObject *)given[5], (PyTypeObject *)given[6]);
    if (frames == NULL)
        return NULL;
    return Py_BuildValue("inN", state, (Py_ssize_t)(sent_count > PY_SSIZE_T_MAX ? PY_SSIZE_T_MAX : sent_count), frames);
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
