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
#define MOST_REGIONS 8
#define CORE_REGISTERS 16
#define STACK_POINTER 13
#define PROGRAM_COUNTER 15

/* unicorn's numbers. */
#define HOOK_OF_TRAPS 1          /* UC_HOOK_INTR */
#define HOOK_OF_INSTRUCTIONS 4   /* UC_HOOK_CODE */
#define INVALID_INSTRUCTION 10   /* UC_ERR_INSN_INVALID */
enum { FPSCR = 6, LR = 10, PC = 11, SP = 12, R0 = 66, S0 = 79, MSP = 115, PSP, CONTROL, XPSR = 120, FAULTMASK = 126 };

/* Why a start returned, beside unicorn's numbers of traps (2 of an SVC, 8 of a branch to EXC_RETURN). */
#define SLEEPS -1
#define WAITS -2
#define UNALIGNED -4
#define ERRORS 1000 /* and unicorn's number */

#define WFI 0xBF30
#define WFE 0xBF20

__extension__ typedef __int128 wide;

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

/* A core: its instructions are started, counted up to a limit, and looked at for the alignment of their accesses
 * (Armv7-M ARM, A3.2.1), which unicorn leaves out. One hook does both: unicorn calls a single one without detours.
 * What an exception keeps on the stack is here, too, and registers of peripherals that need no model to answer. */
struct region { /* memory that may have instructions */
    uint64_t address, size;
    uint8_t *place;
    uint8_t *known; /* what is known of each instruction; NULL where they may change */
};
struct core {
    PyObject_HEAD
    void *engine;
    PyObject *kept; /* what its peripherals are of */
    unsigned long long count, limit;
    long long epoch, done, per_ms; /* the time: epoch [ns] and instructions since */
    uint32_t at;                   /* where it goes on */
    uint32_t reached;              /* the address of an access that is not aligned */
    int trap;
    bool is_running, must_repeat, is_repeating;
    char traps_all;
    int has_masks, has_floats;
    int regions;
    struct region region[MOST_REGIONS];
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

static void take_trap(struct core *of, int number)
{
    of->trap = number;
    uc_emu_stop(of->engine);
}

static void on_trap(void *engine, uint32_t number, void *data)
{
    (void)engine;
    take_trap(data, (int)number);
}

static struct region *region_of(struct core *of, uint32_t address, size_t size)
{
    for (struct region *each = of->region; each < of->region + of->regions; each++)
        if (address - each->address < each->size && size <= each->size - (address - each->address))
            return each;
    return NULL;
}

/* Reads memory; returns unicorn's error. */
static int fetch(struct core *of, uint32_t address, void *bytes, size_t size)
{
    const struct region *region = region_of(of, address, size);
    if (region == NULL)
        return uc_mem_read(of->engine, address, bytes, size);
    memcpy(bytes, region->place + (address - region->address), size);
    return 0;
}

/* Returns unicorn's number of R0 to PC. */
static int number_of(unsigned number)
{
    static const int others[] = {SP, LR, PC};
    return number < STACK_POINTER ? R0 + (int)number : others[number - STACK_POINTER];
}

static uint32_t value_of(struct core *of, unsigned number)
{
    uint32_t value = 0;
    void *at = &value;
    if (number != NO_INDEX)
        uc_reg_read_batch(of->engine, (int[]){number_of(number)}, &at, 1);
    return value;
}

/* What is known of an instruction. */
#define IS_KNOWN 1
#define IS_LOOKED_AT 2  /* always */
#define MAY_BE_LOOKED_AT 4 /* where all accesses are to be aligned */

static struct access decode(const uint16_t *code, unsigned size, bool traps_all)
{
    struct access access = {.alignment = 0};
    if (size == 2)
        decode_short(code[0], traps_all, &access);
    else
        decode_long(code[0], code[1], traps_all, &access);
    return access;
}

static void on_instruction(void *engine, uint64_t address, uint32_t size, void *data)
{
    struct core *of = data;
    if (++of->count > of->limit) {
        uc_emu_stop(engine);
        return;
    }
    const struct region *region = region_of(of, (uint32_t)address, size);
    if (region == NULL)
        return;
    size_t offset = address - region->address;
    const uint16_t *code = (const uint16_t *)(region->place + offset);
    if (region->known != NULL) {
        uint8_t *known = &region->known[offset / 2];
        if (!*known)
            *known = IS_KNOWN | (decode(code, size, false).alignment > 1 ? IS_LOOKED_AT : 0)
                     | (decode(code, size, true).alignment > 1 ? MAY_BE_LOOKED_AT : 0);
        if (!(*known & (of->traps_all ? MAY_BE_LOOKED_AT : IS_LOOKED_AT)))
            return;
    }
    struct access access = decode(code, size, of->traps_all);
    if (access.alignment < 2)
        return;
    of->reached = value_of(of, access.base) + (uint32_t)access.offset + (value_of(of, access.index) << access.shift);
    if (of->reached & (access.alignment - 1))
        take_trap(of, UNALIGNED);
}

static long long time_of(const struct core *of)
{
    wide done = of->done + (of->is_running ? (long long)of->count : 0);
    return of->epoch + (long long)(done * 1000000 / of->per_ms);
}

/* Peripherals. */

/* A range of registers: `kinds` says of each which accesses need no model. */
#define IS_READ 1    /* it reads as its word */
#define IS_WRITTEN 2 /* its word keeps what is written */
#define IS_COUNTED 4 /* it reads as the ramp: counts since a time, up to a most, where it counts */
struct range {
    struct core *core;
    PyObject *read, *write; /* the model's functions */
    uint32_t *words;
    const uint8_t *kinds;
    const int64_t *ramp; /* begin [ns], counts of so many ns by two numbers, the most; 0 ns where it stands */
    uint64_t size;       /* of the registers that have words */
};

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
    if (size == 4 && offset < range->size && range->kinds[offset / 4] & IS_WRITTEN) {
        range->words[offset / 4] = (uint32_t)value;
        return;
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

static PyObject *map_range(PyObject *self, PyObject *arguments)
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

/* Exceptions (Armv7-M ARM, B1.5). */

#define TO_THREAD 8u
#define FROM_PSP 4u
#define WITHOUT_FLOATS 16u
#define EXC_RETURN 0xFFFFFFE1u
#define SPSEL 2u
#define FPCA 4u
#define THUMB (1u << 24)
#define PADDED (1u << 9)
#define IPSR 0x1FFu
#define BASIC 8u /* words of a frame: R0 to R3, R12, LR, PC, XPSR; then the floats */
#define EXTENDED 26u
#define FLOATS 17

static void read_some(struct core *of, int *numbers, uint32_t *values, int count)
{
    void *places[MOST_REGISTERS];
    for (int at = 0; at < count; at++)
        places[at] = &values[at];
    uc_reg_read_batch(of->engine, numbers, places, count);
}

static void write_some(struct core *of, int *numbers, uint32_t *values, int count)
{
    void *places[MOST_REGISTERS];
    for (int at = 0; at < count; at++)
        places[at] = &values[at];
    uc_reg_write_batch(of->engine, numbers, places, count);
}

static int floats[FLOATS] = {S0,     S0 + 1, S0 + 2,  S0 + 3,  S0 + 4,  S0 + 5,  S0 + 6,  S0 + 7, S0 + 8,
                             S0 + 9, S0 + 10, S0 + 11, S0 + 12, S0 + 13, S0 + 14, S0 + 15, FPSCR};

/* Goes on at the function of an exception; false with an exception of Python's where there is no table. */
static bool go_to(struct core *of, uint32_t table, unsigned number)
{
    int error = fetch(of, table + 4 * number, &of->at, sizeof of->at);
    of->at &= ~1u;
    if (error)
        PyErr_Format(PyExc_RuntimeError, "no vectors at 0x%08X", table);
    return !error;
}

static PyObject *enter(PyObject *self, PyObject *arguments)
{
    struct core *of = (struct core *)self;
    unsigned number, table;
    if (!PyArg_ParseTuple(arguments, "II", &number, &table))
        return NULL;
    uint32_t frame[EXTENDED], others[3]; /* XPSR, SP, CONTROL */
    read_some(of, (int[]){R0, R0 + 1, R0 + 2, R0 + 3, R0 + 12, LR}, frame, 6);
    read_some(of, (int[]){XPSR, SP, CONTROL}, others, 3);
    uint32_t status = others[0], sp = others[1], control = others[2];
    bool has_floats = of->has_floats && control & FPCA;
    uint32_t back = EXC_RETURN | (has_floats ? 0 : WITHOUT_FLOATS);
    if (!(status & IPSR))
        back |= TO_THREAD | (control & SPSEL ? FROM_PSP : 0);
    frame[6] = of->at;
    frame[7] = status | (sp & 4 ? PADDED : 0);
    size_t size = 4 * (has_floats ? EXTENDED : BASIC);
    if (has_floats) {
        read_some(of, floats, frame + BASIC, FLOATS);
        frame[EXTENDED - 1] = 0;
    }
    uint32_t top = (sp - (uint32_t)size) & ~7u;
    const struct region *region = region_of(of, top, size);
    if (region != NULL && region->known == NULL)
        memcpy(region->place + (top - region->address), frame, size);
    else if (uc_mem_write(of->engine, top, frame, size))
        return PyLong_FromUnsignedLong(top);
    if (!go_to(of, table, number))
        return NULL;
    write_some(of, (int[]){SP, XPSR, CONTROL, LR},
               (uint32_t[]){top, THUMB | number, control & ~(SPSEL | FPCA), back}, 4);
    Py_RETURN_NONE;
}

static PyObject *end_exception(PyObject *self, PyObject *none)
{
    struct core *of = (struct core *)self;
    (void)none;
    uint32_t faultmask = 0;
    if (of->has_masks)
        read_some(of, (int[]){FAULTMASK}, &faultmask, 1);
    if (faultmask)
        write_some(of, (int[]){FAULTMASK}, (uint32_t[]){0}, 1);
    Py_RETURN_NONE;
}

static PyObject *chain(PyObject *self, PyObject *arguments)
{
    struct core *of = (struct core *)self;
    unsigned number, table;
    uint32_t back = of->at | 1;
    if (!PyArg_ParseTuple(arguments, "II", &number, &table) || !go_to(of, table, number))
        return NULL;
    write_some(of, (int[]){XPSR, LR}, (uint32_t[]){THUMB | number, back}, 2);
    Py_RETURN_NONE;
}

static PyObject *leave(PyObject *self, PyObject *none)
{
    struct core *of = (struct core *)self;
    (void)none;
    uint32_t frame[EXTENDED], stacks[3], back = of->at | 1;
    read_some(of, (int[]){MSP, PSP, CONTROL}, stacks, 3);
    uint32_t sp = stacks[back & FROM_PSP ? 1 : 0], control = stacks[2] & ~(SPSEL | FPCA);
    size_t size = 4 * (back & WITHOUT_FLOATS ? BASIC : EXTENDED);
    if (fetch(of, sp, frame, size))
        return PyLong_FromUnsignedLong(sp);
    uint32_t status = frame[7];
    if (back & FROM_PSP)
        control |= SPSEL;
    if (!(back & WITHOUT_FLOATS)) {
        control |= FPCA;
        write_some(of, floats, frame + BASIC, FLOATS);
    }
    sp += (uint32_t)size + (status & PADDED ? 4 : 0);
    of->at = frame[6];
    /* The mode first: it says which stack pointer the SP is. */
    write_some(of, (int[]){XPSR, CONTROL, SP}, (uint32_t[]){(status & ~PADDED) | THUMB, control, sp}, 3);
    write_some(of, (int[]){R0, R0 + 1, R0 + 2, R0 + 3, R0 + 12, LR}, frame, 6);
    Py_RETURN_NONE;
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

static PyObject *start(PyObject *self, PyObject *given)
{
    struct core *of = (struct core *)self;
    unsigned long long most = PyLong_AsUnsignedLongLong(given);
    if (PyErr_Occurred())
        return NULL;
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
    if (PyErr_Occurred())
        return NULL;
    if (of->trap)
        return PyLong_FromLong(of->trap);
    uint16_t code = 0;
    if (is_early || error)
        fetch(of, of->at - 2, &code, sizeof code);
    if (error)
        return PyLong_FromLong(error == INVALID_INSTRUCTION && code == WFE ? WAITS : ERRORS + error);
    return PyLong_FromLong(is_early && !must_repeat && code == WFI ? SLEEPS : 0);
}

static PyObject *interrupt(PyObject *self, PyObject *none)
{
    struct core *of = (struct core *)self;
    (void)none;
    if (of->is_running && !of->is_repeating && !of->must_repeat) {
        of->must_repeat = true;
        uc_emu_stop(of->engine);
    }
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
    PyObject *handle;
    if (keywords != NULL && PyDict_GET_SIZE(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Core(handle, per_ms, has_masks, has_floats)");
        return -1;
    }
    if (!PyArg_ParseTuple(arguments, "OLpp", &handle, &of->per_ms, &of->has_masks, &of->has_floats))
        return -1;
    of->engine = PyLong_AsVoidPtr(handle);
    if (PyErr_Occurred())
        return -1;
    Py_XSETREF(of->kept, PyList_New(0));
    if (of->kept == NULL)
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
    return 0;
}

static int clear_core(PyObject *self)
{
    Py_CLEAR(((struct core *)self)->kept);
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
    {"start", start, METH_O, "start(count) -> why\n\nDo up to a number of instructions; see the module's numbers."},
    {"interrupt", interrupt, METH_NOARGS, "Have a start return behind the write to a peripheral that it is in."},
    {"trap", trap, METH_O, "trap(number)\n\nHave a start return this."},
    {"now", now, METH_NOARGS, "Return the time, to the instruction [ns]."},
    {"set_time", set_time, METH_O, "set_time(time)\n\nGo on from a time [ns]."},
    {"enter", enter, METH_VARARGS, "enter(number, vectors) -> address\n\nEnter an exception; returns where there is "
                                   "no room on the stack."},
    {"chain", chain, METH_VARARGS, "chain(number, vectors)\n\nEnter an exception behind the end of another."},
    {"end_exception", end_exception, METH_NOARGS, "Clear FAULTMASK."},
    {"leave", leave, METH_NOARGS, "leave() -> address\n\nReturn to what the stack has; returns where there is nothing."},
    {"map", map_range, METH_VARARGS, "map(address, size, read, write, cells) -> error\n\nHave functions answer for a "
                                     "range, but for cells of registers: words, kinds, ramp."},
    {"add_memory", add_memory, METH_VARARGS, "add_memory(address, size, place, is_fixed)\n\nKnow the bytes of memory at "
                                             "a place here."},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef core_members[] = {
    {"at", T_UINT, offsetof(struct core, at), 0, "The address where it goes on."},
    {"reached", T_UINT, offsetof(struct core, reached), READONLY, "The address that was not aligned."},
    {"traps_all", T_BOOL, offsetof(struct core, traps_all), 0, "Whether words and halfwords are to be aligned, too."},
    {NULL, 0, 0, 0, NULL},
};

static PyTypeObject core_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "_calls.Core",
    .tp_doc = "Core(handle, per_ms, has_masks, has_floats)\n\n"
              "A core that does so many instructions in a millisecond. The caller keeps it as long as the engine.",
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
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && (PyModule_AddType(module, &registers_type) < 0 || PyModule_AddType(module, &core_type) < 0))
        Py_CLEAR(module);
    return module;
}
