/* What an exception keeps on the stack: its entry and return (Armv7-M ARM, B1.5). */
#include "core.h"

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

static int floats[FLOATS] = {S0,     S0 + 1, S0 + 2,  S0 + 3,  S0 + 4,  S0 + 5,  S0 + 6,  S0 + 7, S0 + 8,
                             S0 + 9, S0 + 10, S0 + 11, S0 + 12, S0 + 13, S0 + 14, S0 + 15, FPSCR};

/* Goes on at the function of an exception; false with an exception of Python's where there is no table. */
static bool go_to(struct core *of, int number)
{
    uint32_t entry = of->vectors + 4 * (uint32_t)number;
    int error = fetch(of, entry, &of->at, sizeof of->at);
    of->at &= ~1u;
    if (error)
        PyErr_Format(PyExc_RuntimeError, "no vectors at 0x%08X", of->vectors);
    return !error;
}

/* Stacks what an exception may change, and goes to its function. */
int enter_exception(struct core *of, int number)
{
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
    of->number = number;
    of->reached = (sp - (uint32_t)size) & ~7u;
    const struct region *region = region_of(of, of->reached, size);
    if (of->exceptions->actives == MOST_EXCEPTIONS)
        return NO_ROOM;
    if (region != NULL && region->known == NULL)
        memcpy(region->place + (of->reached - region->address), frame, size);
    else if (uc_mem_write(of->engine, of->reached, frame, size))
        return NO_ROOM;
    if (go_to(of, number))
        write_some(of, (int[]){SP, XPSR, CONTROL, LR},
                   (uint32_t[]){of->reached, THUMB | (uint32_t)number, control & ~(SPSEL | FPCA), back}, 4);
    begin_exception(of->exceptions, number);
    of->has_event = true;
    return 0;
}

/* Enters an exception behind the end of another. */
int chain_exception(struct core *of, int number)
{
    uint32_t back = of->at | 1;
    begin_exception(of->exceptions, number);
    if (go_to(of, number))
        write_some(of, (int[]){XPSR, LR}, (uint32_t[]){THUMB | (uint32_t)number, back}, 2);
    return 0;
}

/* Goes back to what the stack has kept. */
int leave_exception(struct core *of)
{
    uint32_t frame[EXTENDED], stacks[3], back = of->at | 1;
    read_some(of, (int[]){MSP, PSP, CONTROL}, stacks, 3);
    uint32_t sp = stacks[back & FROM_PSP ? 1 : 0], control = stacks[2] & ~(SPSEL | FPCA);
    size_t size = 4 * (back & WITHOUT_FLOATS ? BASIC : EXTENDED);
    of->reached = sp;
    if (fetch(of, sp, frame, size))
        return NO_FRAME;
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
    return 0;
}
