/* The ground of the program on an STM32: start-up, time, the queue of frames, the serial port. */
#include "stm32.h"
#include "platform.h"
#include "position_control.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#ifndef TARGETS_MM
#define TARGETS_MM "50,-20"
#endif

#define NVIC_ISER 0xE000E100u
#define NVIC_IPR 0xE000E400u
#define CPACR 0xE000ED88u
#define TIM_CR1 REGISTER(TIM2 + 0x00)
#define TIM_DIER REGISTER(TIM2 + 0x0C)
#define TIM_SR REGISTER(TIM2 + 0x10)
#define TIM_EGR REGISTER(TIM2 + 0x14)
#define TIM_CNT REGISTER(TIM2 + 0x24)
#define TIM_PSC REGISTER(TIM2 + 0x28)
#define TIM_CCR1 REGISTER(TIM2 + 0x34)
#define UPDATE 1u
#define COMPARE 2u
#define MOST_FRAMES 32u

static struct frame queue[MOST_FRAMES];
static volatile unsigned put, taken;
static volatile uint32_t turns; /* of TIM2 */

void enable_interrupt(unsigned number)
{
    ((volatile uint8_t *)NVIC_IPR)[number] = 0x40;
    REGISTER(NVIC_ISER + 4 * (number / 32)) = 1u << number % 32;
}

int64_t platform_now_us(void)
{
    uint32_t before, count;

    do {
        before = turns;
        count = TIM_CNT;
    } while (before != turns);
    return ((int64_t)before << 32) + count;
}

static void on_timer(void)
{
    uint32_t flags = TIM_SR;

    TIM_SR = ~flags;
    if (flags & UPDATE)
        turns++;
}

void keep_frame(const struct frame *frame)
{
    if (put - taken < MOST_FRAMES)
        queue[put++ % MOST_FRAMES] = *frame;
}

static void print(const char *format, va_list arguments)
{
    char text[192];

    vsnprintf(text, sizeof text, format, arguments);
    for (const char *c = text; *c != '\0'; c++)
        chip_print(*c);
}

void platform_warn(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    print(format, arguments);
    va_end(arguments);
}

void platform_tell(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    print(format, arguments);
    va_end(arguments);
}

bool can_bus_open(struct can_bus *bus, const char *name)
{
    (void)bus, (void)name;
    chip_start_can();
    return true;
}

void can_bus_close(struct can_bus *bus)
{
    (void)bus;
}

bool can_bus_flush(struct can_bus *bus)
{
    (void)bus;
    return true;
}

bool can_bus_send(struct can_bus *bus, const struct frame *frame)
{
    (void)bus;
    while (!chip_send(frame))
        ; /* a frame takes 0.1 ms */
    return true;
}

/* Sleeps until an interrupt, unless a frame is there: none comes between the look and the sleep. */
static void sleep_until(int64_t due_us)
{
    TIM_CCR1 = (uint32_t)due_us;
    __asm volatile("cpsid i" ::: "memory");
    if (put == taken && platform_now_us() < due_us)
        __asm volatile("wfi");
    __asm volatile("cpsie i" ::: "memory");
}

enum receive_result can_bus_receive(struct can_bus *bus, struct frame *frame, int64_t timeout_us)
{
    int64_t due_us = platform_now_us() + timeout_us;

    (void)bus;
    while (put == taken) {
        if (platform_now_us() >= due_us)
            return RECEIVE_NOTHING;
        sleep_until(due_us);
    }
    *frame = queue[taken % MOST_FRAMES];
    taken++;
    return RECEIVE_FRAME;
}

static bool is_interrupted(void)
{
    return false;
}

int main(void)
{
    struct options options = default_options();
    struct report report = {0};
    bool has_begun = false;

    TIM_PSC = chip_start() - 1;
    TIM_EGR = UPDATE; /* takes the prescaler over */
    TIM_SR = 0;
    TIM_DIER = UPDATE | COMPARE;
    TIM_CR1 = 1;
    enable_interrupt(TIM2_INTERRUPT);
    options.bus = "the chip's";
    set_option(&options, "targets-mm", TARGETS_MM);
    position_control(&options, &report, is_interrupted, &has_begun);
    for (;;)
        __asm volatile("wfi");
}

/* Start-up: the linker script (stm32.ld) says what is copied where. */

extern uint32_t data_start[], data_end[], data_flash[], bss_start[], bss_end[], stack_top[];

static void reset(void)
{
    const uint32_t *from = data_flash;

    REGISTER(CPACR) |= 0xFu << 20; /* floats */
    for (uint32_t *to = data_start; to < data_end; to++)
        *to = *from++;
    for (uint32_t *to = bss_start; to < bss_end; to++)
        *to = 0;
    main();
}

static void stop(void)
{
    for (;;)
        __asm volatile("bkpt 0");
}

#define EXCEPTIONS 16
#define INTERRUPTS 102

__attribute__((section(".vectors"), used)) static void (*const vectors[EXCEPTIONS + INTERRUPTS])(void) = {
    (void (*)(void))stack_top, reset, stop, stop, stop, stop, stop,
    [EXCEPTIONS + CAN_INTERRUPT] = on_can,
    [EXCEPTIONS + TIM2_INTERRUPT] = on_timer,
};
