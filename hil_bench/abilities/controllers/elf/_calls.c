/* Calls of unicorn and its calls back, with the interpreter's lock held all the while: a chip has some
 * two hundred of them a millisecond, which ctypes takes three times as long for.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <structmember.h>

#define NEVER 0xFFFFFFFEu /* an address that no program comes to */
#define MOST_REGISTERS 32
#define MOST_BYTES 256
#define HOOK_OF_TRAPS 1        /* UC_HOOK_INTR */
#define HOOK_OF_INSTRUCTIONS 4 /* UC_HOOK_CODE */
#define MOST_REGIONS 8
#define CORE_REGISTERS 16
#define STACK_POINTER 13
#define PROGRAM_COUNTER 15

typedef uint64_t (*read_function)(void *engine, uint64_t offset, unsigned size, void *data);
typedef void (*write_function)(void *engine, uint64_t offset, unsigned size, uint64_t value, void *data);

/* unicorn's functions, as `use` was given them. */
static int (*uc_emu_start)(void *, uint64_t, uint64_t, uint64_t, size_t);
static int (*uc_emu_stop)(void *);
static int (*uc_mem_read)(void *, uint64_t, void *, size_t);
static int (*uc_mem_write)(void *, uint64_t, const void *, size_t);
static int (*uc_reg_read_batch)(void *, int *, void **, int);
static int (*uc_reg_write_batch)(void *, int *, void *const *, int);
static int (*uc_mmio_map)(void *, uint64_t, size_t, read_function, void *, write_function, void *);
static int (*uc_hook_add)(void *, size_t *, int, void *, void *, uint64_t, uint64_t, ...);
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
    if (PyErr_Occurred())
        return 0;
    PyObject *arguments[] = {PyLong_FromUnsignedLongLong(offset), PyLong_FromUnsignedLong(size)};
    PyObject *result = call(engine, PyTuple_GET_ITEM((PyObject *)data, 0), arguments, 2);
    uint64_t value = result != NULL ? PyLong_AsUnsignedLongLongMask(result) : 0;
    Py_XDECREF(result);
    if (result != NULL && PyErr_Occurred())
        uc_emu_stop(engine);
    return value;
}

static void on_write(void *engine, uint64_t offset, unsigned size, uint64_t value, void *data)
{
    if (PyErr_Occurred())
        return;
    PyObject *arguments[] = {
        PyLong_FromUnsignedLongLong(offset), PyLong_FromUnsignedLong(size), PyLong_FromUnsignedLongLong(value)};
    Py_XDECREF(call(engine, PyTuple_GET_ITEM((PyObject *)data, 1), arguments, 3));
}

static void on_trap(void *engine, uint32_t number, void *data)
{
    if (PyErr_Occurred())
        return;
    PyObject *arguments[] = {PyLong_FromUnsignedLong(number)};
    Py_XDECREF(call(engine, data, arguments, 1));
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

PyDoc_STRVAR(stop_doc, "stop(handle)\n\nHave a start return.");

static PyObject *stop(PyObject *module, PyObject *handle)
{
    (void)module;
    void *engine = PyLong_AsVoidPtr(handle);
    if (PyErr_Occurred())
        return NULL;
    uc_emu_stop(engine);
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

PyDoc_STRVAR(map_doc, "map_functions(handle, address, size, (read, write)) -> error\n\n"
                      "Have functions answer for a range; the caller keeps the tuple.");

static PyObject *map_functions(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (!has_given(count, 4))
        return NULL;
    void *engine = PyLong_AsVoidPtr(given[0]);
    uint64_t address = PyLong_AsUnsignedLongLong(given[1]);
    size_t size = PyLong_AsSize_t(given[2]);
    if (!PyErr_Occurred() && (!PyTuple_Check(given[3]) || PyTuple_GET_SIZE(given[3]) != 2))
        PyErr_SetString(PyExc_TypeError, "a tuple of two functions");
    if (PyErr_Occurred())
        return NULL;
    return PyLong_FromLong(uc_mmio_map(engine, address, size, on_read, given[3], on_write, given[3]));
}

PyDoc_STRVAR(hook_doc, "hook_traps(handle, take) -> error\n\n"
                       "Have a function take the number of each trap; the caller keeps it.");

static PyObject *hook_traps(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (!has_given(count, 2))
        return NULL;
    void *engine = PyLong_AsVoidPtr(given[0]);
    if (PyErr_Occurred())
        return NULL;
    size_t hook;
    return PyLong_FromLong(uc_hook_add(engine, &hook, HOOK_OF_TRAPS, (void *)on_trap, given[1], 1, 0));
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

/* The instructions of a core: started, counted up to a limit, and looked at for the alignment of their accesses
 * (Armv7-M ARM, A3.2.1), which unicorn leaves out. One hook does both: unicorn calls a single one without detours. */
struct instructions {
    PyObject_HEAD
    void *engine;
    PyObject *take;
    unsigned long long count, limit;
    char traps_all;
    int registers[CORE_REGISTERS]; /* unicorn's numbers */
    int regions;                   /* where instructions are */
    struct {
        uint64_t address, size;
        const uint16_t *code;
    } region[MOST_REGIONS];
};

/* The address of an access: base + (index << shift) + offset, and the alignment that it has to have. */
struct access {
    unsigned base, index, shift;
    int32_t offset;
    unsigned alignment;
};
#define NO_INDEX CORE_REGISTERS

/* Decodes loads and stores of 16 bits; `alignment` stays 0 where any will do. */
static void decode_short(unsigned code, bool traps_all, struct access *access)
{
    static const uint8_t sizes[] = {4, 2, 1, 1, 4, 2, 1, 2}; /* STR, STRH, STRB, LDRSB, LDR, LDRH, LDRB, LDRSH */
    unsigned offset = code >> 6 & 31;
    if (code >> 12 == 0xC) /* LDM, STM */
        *access = (struct access){.base = code >> 8 & 7, .index = NO_INDEX, .alignment = 4};
    if (!traps_all)
        return;
    if (code >> 12 == 5)
        *access = (struct access){.base = code >> 3 & 7, .index = code >> 6 & 7, .alignment = sizes[code >> 9 & 7]};
    else if (code >> 12 == 6)
        *access = (struct access){code >> 3 & 7, NO_INDEX, 0, (int32_t)offset * 4, 4};
    else if (code >> 12 == 8)
        *access = (struct access){code >> 3 & 7, NO_INDEX, 0, (int32_t)offset * 2, 2};
}

/* Decodes loads and stores of 32 bits, but for exclusive ones, which unicorn looks at. */
static void decode_long(unsigned code, unsigned more, bool traps_all, struct access *access)
{
    unsigned base = code & 15;
    bool is_multiple = (code & 0xFE40) == 0xE800;                        /* LDM, STM */
    bool is_double = (code & 0xFE40) == 0xE840 && code & 0x120;          /* LDRD, STRD */
    bool is_float = (code & 0xFE00) == 0xEC00 && (more & 0xE00) == 0xA00 /* VLDR, VSTR, VLDM, VSTM */
                    && (code & 0xFFE0) != 0xEC40;
    if (is_multiple || is_double || is_float) {
        if (base != STACK_POINTER && base != PROGRAM_COUNTER) /* always aligned */
            *access = (struct access){.base = base, .index = NO_INDEX, .alignment = 4};
    } else if (traps_all && (code & 0xFE00) == 0xF800 && base != PROGRAM_COUNTER) {
        *access = (struct access){.base = base, .index = NO_INDEX, .alignment = 1u << (code >> 5 & 3)};
        if (code & 0x80)
            access->offset = more & 0xFFF;
        else if (!(more & 0x800))
            access->index = more & 15, access->shift = more >> 4 & 3;
        else if (more & 0x400) /* before the access */
            access->offset = more & 0x200 ? (int32_t)(more & 0xFF) : -(int32_t)(more & 0xFF);
    }
}

static uint32_t value_of(struct instructions *of, unsigned number)
{
    uint32_t value = 0;
    void *at = &value;
    if (number != NO_INDEX)
        uc_reg_read_batch(of->engine, &of->registers[number], &at, 1);
    return value;
}

static void on_instruction(void *engine, uint64_t address, uint32_t size, void *data)
{
    struct instructions *of = data;
    if (++of->count > of->limit) {
        uc_emu_stop(engine);
        return;
    }
    const uint16_t *code = NULL;
    for (int at = 0; at < of->regions && code == NULL; at++)
        if (address - of->region[at].address < of->region[at].size)
            code = of->region[at].code + (address - of->region[at].address) / 2;
    if (code == NULL)
        return;
    struct access access = {.alignment = 0};
    if (size == 2)
        decode_short(code[0], of->traps_all, &access);
    else
        decode_long(code[0], code[1], of->traps_all, &access);
    if (access.alignment < 2)
        return;
    uint32_t reached = value_of(of, access.base) + (uint32_t)access.offset
                       + (value_of(of, access.index) << access.shift);
    if (reached & (access.alignment - 1) && !PyErr_Occurred()) {
        PyObject *arguments[] = {PyLong_FromUnsignedLong(reached)};
        Py_XDECREF(call(engine, of->take, arguments, 1));
    }
}

static int make_instructions(PyObject *self, PyObject *arguments, PyObject *keywords)
{
    struct instructions *of = (struct instructions *)self;
    PyObject *handle, *take, *registers;
    if (keywords != NULL && PyDict_GET_SIZE(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Instructions(handle, take, registers)");
        return -1;
    }
    if (!PyArg_ParseTuple(arguments, "OOO!", &handle, &take, &PyTuple_Type, &registers))
        return -1;
    if (PyTuple_GET_SIZE(registers) != CORE_REGISTERS) {
        PyErr_Format(PyExc_ValueError, "%zd registers, not %d", PyTuple_GET_SIZE(registers), CORE_REGISTERS);
        return -1;
    }
    for (int at = 0; at < CORE_REGISTERS; at++)
        of->registers[at] = (int)PyLong_AsLong(PyTuple_GET_ITEM(registers, at));
    of->engine = PyLong_AsVoidPtr(handle);
    if (PyErr_Occurred())
        return -1;
    Py_XSETREF(of->take, Py_NewRef(take));
    size_t hook;
    int error = uc_hook_add(of->engine, &hook, HOOK_OF_INSTRUCTIONS, (void *)on_instruction, of, 1, 0);
    if (error)
        PyErr_Format(PyExc_RuntimeError, "unicorn's error %d", error);
    return error ? -1 : 0;
}

static PyObject *start(PyObject *self, PyObject *const *given, Py_ssize_t count)
{
    struct instructions *of = (struct instructions *)self;
    if (!has_given(count, 2))
        return NULL;
    uint64_t address = PyLong_AsUnsignedLongLong(given[0]);
    of->limit = PyLong_AsUnsignedLongLong(given[1]);
    if (PyErr_Occurred())
        return NULL;
    of->count = 0;
    int error = uc_emu_start(of->engine, address | 1, NEVER, 0, 0);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(error);
}

static PyObject *add_code(PyObject *self, PyObject *const *given, Py_ssize_t count)
{
    struct instructions *of = (struct instructions *)self;
    if (!has_given(count, 3))
        return NULL;
    if (of->regions == MOST_REGIONS)
        return PyErr_Format(PyExc_ValueError, "more than %d regions", MOST_REGIONS);
    of->region[of->regions].address = PyLong_AsUnsignedLongLong(given[0]);
    of->region[of->regions].size = PyLong_AsUnsignedLongLong(given[1]);
    of->region[of->regions].code = PyLong_AsVoidPtr(given[2]);
    if (PyErr_Occurred())
        return NULL;
    of->regions++;
    Py_RETURN_NONE;
}

static int visit_instructions(PyObject *self, visitproc visit, void *arg)
{
    Py_VISIT(((struct instructions *)self)->take);
    return 0;
}

static int clear_instructions(PyObject *self)
{
    Py_CLEAR(((struct instructions *)self)->take);
    return 0;
}

static void end_instructions(PyObject *self)
{
    PyObject_GC_UnTrack(self);
    clear_instructions(self);
    Py_TYPE(self)->tp_free(self);
}

static PyMethodDef instructions_methods[] = {
    {"start", (PyCFunction)(void (*)(void))start, METH_FASTCALL,
     "start(address, count) -> error\n\nDo up to a number of instructions."},
    {"add_code", (PyCFunction)(void (*)(void))add_code, METH_FASTCALL,
     "add_code(address, size, place)\n\nLook at the accesses of instructions in a range, whose bytes are at a place here."},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef instructions_members[] = {
    {"count", T_ULONGLONG, offsetof(struct instructions, count), READONLY, "Since the last start."},
    {"traps_all", T_BOOL, offsetof(struct instructions, traps_all), 0, "Whether words and halfwords are to be aligned, too."},
    {NULL, 0, 0, 0, NULL},
};

static PyTypeObject instructions_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Instructions",
    .tp_doc = "Instructions(handle, take, registers)\n\n"
              "The instructions of a core; a function takes the address of an access that is not aligned, in front of it.\n"
              "The registers are unicorn's numbers of R0 to PC. The caller keeps it as long as the engine.",
    .tp_basicsize = sizeof(struct instructions),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC,
    .tp_new = PyType_GenericNew,
    .tp_init = make_instructions,
    .tp_dealloc = end_instructions,
    .tp_traverse = visit_instructions,
    .tp_clear = clear_instructions,
    .tp_methods = instructions_methods,
    .tp_members = instructions_members,
};

#define FAST(function) (PyCFunction)(void (*)(void))function, METH_FASTCALL

static PyMethodDef methods[] = {
    {"use", FAST(use), use_doc},
    {"stop", stop, METH_O, stop_doc},
    {"read", FAST(read_memory), read_doc},
    {"write", FAST(write_memory), write_doc},
    {"map_functions", FAST(map_functions), map_doc},
    {"hook_traps", FAST(hook_traps), hook_doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_calls", "Calls of unicorn.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__calls(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && (PyModule_AddType(module, &registers_type) < 0 || PyModule_AddType(module, &instructions_type) < 0))
        Py_CLEAR(module);
    return module;
}
