/* The plant's kernels, which Numba compiled ahead of time, as functions for Python.

   `compile.py` beside this file writes kernels.h: which kernels there are, by what names Numba's
   object files have them, and of which sources they are. A kernel takes each row as Numba hands an
   array over, and the numbers behind them. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define SEEN 8
#define MOST_ROWS 5

#define ROW_TYPES void *, void *, int64_t, int64_t, double *, int64_t, int64_t
#define ROW(view)                                                                                  \
    NULL, NULL, (view).len / (int64_t)sizeof(double), (int64_t)sizeof(double),                     \
        (double *)(view).buf, (view).len / (int64_t)sizeof(double), (int64_t)sizeof(double)

typedef int Advance(double *seen, void **error, ROW_TYPES, ROW_TYPES, double u, double load,
                    int64_t steps);
typedef int MoveGroup(int64_t *moved, void **error, ROW_TYPES, ROW_TYPES, ROW_TYPES, ROW_TYPES,
                      ROW_TYPES, int64_t count, int64_t steps);

#include "kernels.h"

/* Numba's code asks for it where a row would be freed; it frees none, for each is without owner. */
void NRT_MemInfo_call_dtor(void *info) { (void)info; }

static const struct {
    const char *name;
    Advance *function;
} ADVANCES[] = {
#define ENTRY(name, function) {name, function},
    KERNELS(ENTRY)
#undef ENTRY
};

/* A kernel with the rows that it moves on, whose memory stays where it is meanwhile. */
typedef struct {
    PyObject_HEAD
    vectorcallfunc call;
    Advance *advance;
    int rows;
    Py_buffer views[MOST_ROWS];
} Bound;

static PyObject *refuse_count(Py_ssize_t wanted, size_t flags, PyObject *names)
{
    if (names != NULL || PyVectorcall_NARGS(flags) != wanted)
        PyErr_Format(PyExc_TypeError, "a kernel takes %zd numbers here", wanted);
    return PyErr_Occurred();
}

static PyObject *refuse_failure(void)
{
    PyErr_SetString(PyExc_RuntimeError, "a kernel of the plant has failed");
    return NULL;
}

static PyObject *call_advance(PyObject *self, PyObject *const *values, size_t flags,
                              PyObject *names)
{
    Bound *bound = (Bound *)self;
    if (refuse_count(3, flags, names) != NULL)
        return NULL;
    double u = PyFloat_AsDouble(values[0]), load = PyFloat_AsDouble(values[1]);
    int64_t steps = PyLong_AsLongLong(values[2]);
    if (PyErr_Occurred())
        return NULL;
    double seen[SEEN];
    void *error = NULL;
    if (bound->advance(seen, &error, ROW(bound->views[0]), ROW(bound->views[1]), u, load, steps))
        return refuse_failure();
    if (!isfinite(seen[0] + seen[1] + seen[2] + seen[3])) {
        PyErr_SetString(PyExc_FloatingPointError, "the state is not finite");
        return NULL;
    }
    PyObject *result = PyTuple_New(SEEN);
    if (result == NULL)
        return NULL;
    for (int place = 0; place < SEEN; place++) {
        PyObject *value = PyFloat_FromDouble(seen[place]);
        if (value == NULL) {
            Py_DECREF(result);
            return NULL;
        }
        PyTuple_SET_ITEM(result, place, value);
    }
    return result;
}

static PyObject *call_group(PyObject *self, PyObject *const *values, size_t flags, PyObject *names)
{
    Bound *bound = (Bound *)self;
    if (refuse_count(2, flags, names) != NULL)
        return NULL;
    int64_t count = PyLong_AsLongLong(values[0]), steps = PyLong_AsLongLong(values[1]);
    if (PyErr_Occurred())
        return NULL;
    int64_t moved = 0;
    void *error = NULL;
    Py_buffer *views = bound->views;
    if (MOVE_GROUP(&moved, &error, ROW(views[0]), ROW(views[1]), ROW(views[2]), ROW(views[3]),
                   ROW(views[4]), count, steps))
        return refuse_failure();
    return PyLong_FromLongLong(moved);
}

static bool hold_row(Bound *bound, PyObject *row)
{
    Py_buffer *view = &bound->views[bound->rows];
    if (PyObject_GetBuffer(row, view, PyBUF_CONTIG | PyBUF_FORMAT) < 0)
        return false;
    bound->rows++;
    if (view->ndim == 1 && view->format != NULL && strcmp(view->format, "d") == 0)
        return true;
    PyErr_SetString(PyExc_TypeError, "a row must be one of float64 numbers, without gaps");
    return false;
}

static void Bound_dealloc(PyObject *self)
{
    Bound *bound = (Bound *)self;
    for (int row = 0; row < bound->rows; row++)
        PyBuffer_Release(&bound->views[row]);
    Py_TYPE(self)->tp_free(self);
}

static PyTypeObject BoundType = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "hil_bench.plants.hydraulic_cylinder.model._kernels.Bound",
    .tp_basicsize = sizeof(Bound),
    .tp_dealloc = Bound_dealloc,
    .tp_vectorcall_offset = offsetof(Bound, call),
    .tp_call = PyVectorcall_Call,
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL,
    .tp_doc = "A kernel with the rows that it moves on.",
};

static PyObject *bind(PyObject *module, PyObject *const *values, Py_ssize_t count)
{
    (void)module;
    const char *name = count > 0 ? PyUnicode_AsUTF8(values[0]) : "";
    if (name == NULL)
        return NULL;
    Advance *advance = NULL;
    for (size_t place = 0; place < sizeof ADVANCES / sizeof *ADVANCES; place++)
        if (strcmp(name, ADVANCES[place].name) == 0)
            advance = ADVANCES[place].function;
    Py_ssize_t rows = advance != NULL ? 2 : MOST_ROWS;
    if ((advance == NULL && strcmp(name, "move_group") != 0) || count != 1 + rows)
        return PyErr_Format(PyExc_ValueError, "no kernel %s of %zd rows", name, count - 1);
    Bound *bound = PyObject_New(Bound, &BoundType);
    if (bound == NULL)
        return NULL;
    bound->call = advance != NULL ? call_advance : call_group;
    bound->advance = advance;
    bound->rows = 0;
    for (Py_ssize_t row = 0; row < rows; row++)
        if (!hold_row(bound, values[1 + row])) {
            Py_DECREF(bound);
            return NULL;
        }
    return (PyObject *)bound;
}

/* What LEVEL takes for granted and this processor, or the system that it is under, lacks. */
static PyObject *missing_instructions(PyObject *module, PyObject *none)
{
    (void)module, (void)none;
    __builtin_cpu_init();
    PyObject *missing = PyList_New(0);
#define CHECK(feature)                                                                             \
    if (missing != NULL && !__builtin_cpu_supports(feature)) {                                     \
        PyObject *name = PyUnicode_FromString(feature);                                            \
        if (name == NULL || PyList_Append(missing, name) < 0)                                      \
            Py_CLEAR(missing);                                                                     \
        Py_XDECREF(name);                                                                          \
    }
    FEATURES(CHECK)
#undef CHECK
    return missing;
}

static PyMethodDef METHODS[] = {
    {"bind", (PyCFunction)(void (*)(void))bind, METH_FASTCALL,
     "Return a kernel, by its name, with the rows that it moves on."},
    {"missing_instructions", missing_instructions, METH_NOARGS,
     "Return the instruction sets that the kernels need and this processor lacks."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef MODULE = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_kernels",
    .m_doc = "The plant's kernels, compiled ahead of time.",
    .m_size = -1,
    .m_methods = METHODS,
};

PyMODINIT_FUNC PyInit__kernels(void)
{
    if (PyType_Ready(&BoundType) < 0)
        return NULL;
    PyObject *module = PyModule_Create(&MODULE);
    if (module == NULL)
        return NULL;
    if (PyModule_AddStringConstant(module, "SOURCES", SOURCES) < 0 ||
        PyModule_AddStringConstant(module, "COMPILER", COMPILER) < 0 ||
        PyModule_AddStringConstant(module, "LEVEL", LEVEL) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
