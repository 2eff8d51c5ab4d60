/* Calls of unicorn and its calls back, with the interpreter's lock held all the while: a chip has some
 * two hundred of them a millisecond, which ctypes takes three times as long for.
 */
#include "core.h"

#define MOST_BYTES 256

int (*uc_emu_start)(void *, uint64_t, uint64_t, uint64_t, size_t);
int (*uc_emu_stop)(void *);
int (*uc_mem_read)(void *, uint64_t, void *, size_t);
int (*uc_mem_write)(void *, uint64_t, const void *, size_t);
int (*uc_reg_read_batch)(void *, int *, void **, int);
int (*uc_reg_write_batch)(void *, int *, void *const *, int);
int (*uc_mmio_map)(void *, uint64_t, size_t, read_function, void *, write_function, void *);
int (*uc_hook_add)(void *, size_t *, int, void *, void *, uint64_t, uint64_t, ...);
static void *const functions[] = {&uc_emu_start,     &uc_emu_stop,        &uc_mem_read, &uc_mem_write,
                                  &uc_reg_read_batch, &uc_reg_write_batch, &uc_mmio_map, &uc_hook_add};
#define FUNCTIONS (Py_ssize_t)(sizeof functions / sizeof functions[0])

/* Raises TypeError unless so many arguments were given. */
static bool has_given(Py_ssize_t count, Py_ssize_t right)
{
    if (count != right)
        PyErr_Format(PyExc_TypeError, "%zd arguments, not %zd", right, count);
    return count == right;
}

PyDoc_STRVAR(use_doc, "use(*addresses)\n\nTake unicorn's functions by their addresses, in the order of the source.");

static PyObject *use(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (!has_given(count, FUNCTIONS))
        return NULL;
    for (Py_ssize_t at = 0; at < FUNCTIONS; at++) {
        void *address = PyLong_AsVoidPtr(given[at]);
        memcpy(functions[at], &address, sizeof address);
    }
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

PyDoc_STRVAR(read_doc, "read(handle, address, size) -> bytes or error\n\nReturn bytes of memory.");

static PyObject *read_memory(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (!has_given(count, 3))
        return NULL;
    void *engine = PyLong_AsVoidPtr(given[0]);
    uint64_t address = PyLong_AsUnsignedLongLong(given[1]);
    size_t size = PyLong_AsSize_t(given[2]);
    char bytes[MOST_BYTES];
    if (!PyErr_Occurred() && size > sizeof bytes)
        PyErr_Format(PyExc_ValueError, "%zu bytes, more than %zu", size, sizeof bytes);
    if (PyErr_Occurred())
        return NULL;
    int error = uc_mem_read(engine, address, bytes, size);
    return error ? PyLong_FromLong(error) : PyBytes_FromStringAndSize(bytes, (Py_ssize_t)size);
}

PyDoc_STRVAR(write_doc, "write(handle, address, data) -> error\n\nWrite bytes to memory.");

static PyObject *write_memory(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (!has_given(count, 3))
        return NULL;
    void *engine = PyLong_AsVoidPtr(given[0]);
    uint64_t address = PyLong_AsUnsignedLongLong(given[1]);
    if (!PyErr_Occurred() && !PyBytes_Check(given[2]))
        PyErr_SetString(PyExc_TypeError, "data are bytes");
    if (PyErr_Occurred())
        return NULL;
    return PyLong_FromLong(
        uc_mem_write(engine, address, PyBytes_AS_STRING(given[2]), (size_t)PyBytes_GET_SIZE(given[2])));
}

/* Some registers, read and written together. */
struct registers {
    PyObject_HEAD
    void *engine;
    int count;
    int numbers[MOST_REGISTERS];
    uint32_t values[MOST_REGISTERS];
    void *pointers[MOST_REGISTERS];
};

static int make_registers(PyObject *self, PyObject *arguments, PyObject *keywords)
{
    struct registers *registers = (struct registers *)self;
    PyObject *handle, *numbers;
    if (keywords != NULL && PyDict_GET_SIZE(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Registers(handle, numbers)");
        return -1;
    }
    if (!PyArg_ParseTuple(arguments, "OO!", &handle, &PyTuple_Type, &numbers))
        return -1;
    if (PyTuple_GET_SIZE(numbers) > MOST_REGISTERS) {
        PyErr_Format(PyExc_ValueError, "more than %d registers", MOST_REGISTERS);
        return -1;
    }
    registers->engine = PyLong_AsVoidPtr(handle);
    registers->count = (int)PyTuple_GET_SIZE(numbers);
    for (int at = 0; at < registers->count; at++) {
        registers->numbers[at] = (int)PyLong_AsLong(PyTuple_GET_ITEM(numbers, at));
        registers->pointers[at] = &registers->values[at];
    }
    return PyErr_Occurred() ? -1 : 0;
}

static PyObject *read_registers(PyObject *self, PyObject *none)
{
    struct registers *registers = (struct registers *)self;
    (void)none;
    uc_reg_read_batch(registers->engine, registers->numbers, registers->pointers, registers->count);
    PyObject *values = PyList_New(registers->count);
    for (int at = 0; values != NULL && at < registers->count; at++) {
        PyObject *value = PyLong_FromUnsignedLong(registers->values[at]);
        if (value == NULL)
            Py_CLEAR(values);
        else
            PyList_SET_ITEM(values, at, value);
    }
    return values;
}

static PyObject *write_registers(PyObject *self, PyObject *given)
{
    struct registers *registers = (struct registers *)self;
    PyObject *values = PySequence_Fast(given, "values of registers");
    if (values == NULL)
        return NULL;
    if (PySequence_Fast_GET_SIZE(values) != registers->count)
        PyErr_Format(PyExc_ValueError, "values of %d registers, not %zd", registers->count,
                     PySequence_Fast_GET_SIZE(values));
    for (int at = 0; !PyErr_Occurred() && at < registers->count; at++)
        registers->values[at] = (uint32_t)PyLong_AsUnsignedLongMask(PySequence_Fast_GET_ITEM(values, at));
    Py_DECREF(values);
    if (PyErr_Occurred())
        return NULL;
    uc_reg_write_batch(registers->engine, registers->numbers, registers->pointers, registers->count);
    Py_RETURN_NONE;
}

static PyMethodDef registers_methods[] = {
    {"read", read_registers, METH_NOARGS, "Return their values."},
    {"write", write_registers, METH_O, "Set them, in their order."},
    {NULL, NULL, 0, NULL},
};

static PyTypeObject registers_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Registers",
    .tp_doc = "Registers(handle, numbers)\n\nSome registers, read and written together.",
    .tp_basicsize = sizeof(struct registers),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = PyType_GenericNew,
    .tp_init = make_registers,
    .tp_methods = registers_methods,
};

#define FAST(function) (PyCFunction)(void (*)(void))function, METH_FASTCALL

static PyMethodDef methods[] = {
    {"use", FAST(use), use_doc},
    {"read", FAST(read_memory), read_doc},
    {"write", FAST(write_memory), write_doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_calls", "Calls of unicorn.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__calls(void)
{
    PyTypeObject *types[] = {&registers_type, &alarm_type, &timeline_type, &exceptions_type, &core_type};
    PyObject *module = PyModule_Create(&definition);
    for (size_t at = 0; module != NULL && at < sizeof types / sizeof types[0]; at++)
        if (PyModule_AddType(module, types[at]) < 0)
            Py_CLEAR(module);
    return module;
}
