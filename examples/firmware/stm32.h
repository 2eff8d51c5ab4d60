/* What a chip's part of the program gives: stm32f4.c and stm32g4.c, each with its own registers.
 *
 * stm32.c is the rest: the clock that counts microseconds, the queue of received frames, start-up.
 */
#ifndef STM32_H
#define STM32_H

#include "can_bus.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))

/* Of TIM2, whose counter has 32 bits on both chips. */
#define TIM2 0x40000000u
#define TIM2_INTERRUPT 28

/* Sets the clocks, the pins, the serial port and TIM2's clock; returns TIM2's clock [MHz]. */
uint32_t chip_start(void);

/* Starts CAN at 1 Mbit/s, every frame into its first FIFO with an interrupt. */
void chip_start_can(void);

/* Hands a frame to the controller; false where it has no room. */
bool chip_send(const struct frame *frame);

/* Writes a byte to the serial port. */
void chip_print(char byte);

void enable_interrupt(unsigned number);

/* Keeps a frame that was received; called by the interrupt. */
void keep_frame(const struct frame *frame);

/* The interrupt of the CAN controller. */
void on_can(void);

#endif
