/* A vector table of the functions that a program names by macros; behind the program. */
#ifndef SVC
#define SVC 0
#endif
#ifndef PENDSV
#define PENDSV 0
#endif
#ifndef SYSTICK
#define SYSTICK 0
#endif
#ifndef INTERRUPTS
#define INTERRUPTS
#endif
__attribute__((section(".vectors"), used)) static void (*const vectors[48])(void) = {
    (void (*)(void))0x20001000, program, [11] = SVC, [14] = PENDSV, [15] = SYSTICK, INTERRUPTS };
