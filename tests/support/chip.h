/* Registers of an STM32F4, and what the small programs of the tests have in common. */
#include <stdint.h>
#define R32(address) (*(volatile uint32_t *)(address))
#define R8(address) (*(volatile uint8_t *)(address))
#define CAN1 0x40006400u
static void put(char c) { R32(0x40004404) = (uint8_t)c; }            /* USART2 of an F4 */
static __attribute__((unused)) void say(const char *text) { while (*text) put(*text++); put(10); }
static __attribute__((unused)) void pend(unsigned n)
{ R32(0xE000E200) = 1u << n; __asm volatile("dsb\nisb"); }
static __attribute__((unused)) void allow(unsigned n, uint8_t priority)
{ R8(0xE000E400 + n) = priority; R32(0xE000E100) = 1u << n; }
static __attribute__((unused)) void rest(void) { for (;;) __asm volatile("wfi"); }
void program(void);
