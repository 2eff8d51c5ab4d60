/* The alignment of accesses (Armv7-M ARM, A3.2.1), which unicorn leaves out. */
#include "core.h"

#define CORE_REGISTERS 16
#define STACK_POINTER 13
#define PROGRAM_COUNTER 15

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

static struct access decode(const uint16_t *code, unsigned size, bool traps_all)
{
    struct access access = {.alignment = 0};
    if (size == 2)
        decode_short(code[0], traps_all, &access);
    else
        decode_long(code[0], code[1], traps_all, &access);
    return access;
}

/* Has the core stop in front of an access that is not aligned. */
void look_at_alignment(struct core *of, uint32_t address, uint32_t size)
{
    const struct region *region = region_of(of, address, size);
    if (region == NULL)
        return;
    const uint16_t *code = (const uint16_t *)(region->place + (address - region->address));
    if (region->known != NULL) {
        uint8_t *known = &region->known[(address - region->address) / 2];
        if (!*known)
            *known = IS_KNOWN | (decode(code, size, false).alignment > 1 ? 0 : IS_PLAIN)
                     | (decode(code, size, true).alignment > 1 ? 0 : IS_ALWAYS_PLAIN);
        if (*known & IS_PLAIN << of->traps_all)
            return;
    }
    struct access access = decode(code, size, of->traps_all);
    if (access.alignment < 2)
        return;
    of->reached = value_of(of, access.base) + (uint32_t)access.offset + (value_of(of, access.index) << access.shift);
    if (of->reached & (access.alignment - 1))
        take_trap(of, UNALIGNED);
}
