/* STM32G431 at 170 MHz from its own 16 MHz: FDCAN 1 on PB8 and PB9, USART2 on PA2 (RM0440). */
#include "stm32.h"

#include <string.h>

#define RCC 0x40021000u
#define RCC_CR REGISTER(RCC + 0x00)
#define RCC_CFGR REGISTER(RCC + 0x08)
#define RCC_PLLCFGR REGISTER(RCC + 0x0C)
#define RCC_AHB2ENR REGISTER(RCC + 0x4C)
#define RCC_APB1ENR1 REGISTER(RCC + 0x58)
#define RCC_CCIPR REGISTER(RCC + 0x88)
#define FLASH_ACR REGISTER(0x40022000u)
#define GPIOA 0x48000000u
#define GPIOB 0x48000400u
#define GPIO_MODER 0x00
#define GPIO_AFRL 0x20
#define GPIO_AFRH 0x24
#define USART2 0x40004400u
#define CAN 0x40006400u
#define CAN_CCCR REGISTER(CAN + 0x18)
#define CAN_NBTP REGISTER(CAN + 0x1C)
#define CAN_IR REGISTER(CAN + 0x50)
#define CAN_IE REGISTER(CAN + 0x54)
#define CAN_ILE REGISTER(CAN + 0x5C)
#define CAN_RXGFC REGISTER(CAN + 0x80)
#define CAN_RXF0S REGISTER(CAN + 0x90)
#define CAN_RXF0A REGISTER(CAN + 0x94)
#define CAN_TXFQS REGISTER(CAN + 0xC4)
#define CAN_TXBAR REGISTER(CAN + 0xCC)
#define MESSAGES 0x4000A400u
#define ELEMENT 72u
#define RECEIVED(number, word) REGISTER(MESSAGES + 0xB0 + ELEMENT * (number) + 4 * (word))
#define SENT(number, word) REGISTER(MESSAGES + 0x278 + ELEMENT * (number) + 4 * (word))

uint32_t chip_start(void)
{
    RCC_PLLCFGR = 2u | 3u << 4 | 85u << 8 | 1u << 24; /* 16 MHz / 4 * 85 / 2 */
    RCC_CR |= 1u << 24;
    while (!(RCC_CR & 1u << 25))
        ;
    FLASH_ACR = 4u;
    RCC_CFGR = 3u;
    while ((RCC_CFGR >> 2 & 3u) != 3u)
        ;
    RCC_CCIPR |= 2u << 24; /* FDCAN has the clock of APB1 */
    RCC_AHB2ENR |= 3u;
    RCC_APB1ENR1 |= 1u | 1u << 17 | 1u << 25;
    REGISTER(GPIOA + GPIO_MODER) = (REGISTER(GPIOA + GPIO_MODER) & ~(3u << 4)) | 2u << 4;
    REGISTER(GPIOA + GPIO_AFRL) |= 7u << 8;
    REGISTER(GPIOB + GPIO_MODER) = (REGISTER(GPIOB + GPIO_MODER) & ~(15u << 16)) | 10u << 16;
    REGISTER(GPIOB + GPIO_AFRH) |= 0x99u;
    REGISTER(USART2 + 0x0C) = 170000000u / 115200u;
    REGISTER(USART2 + 0x00) = 1u << 3 | 1u;
    return 170;
}

void chip_print(char byte)
{
    while (!(REGISTER(USART2 + 0x1C) & 1u << 7))
        ;
    REGISTER(USART2 + 0x28) = (uint8_t)byte;
}

void chip_start_can(void)
{
    CAN_CCCR |= 1u;
    while (!(CAN_CCCR & 1u))
        ;
    CAN_CCCR |= 2u;
    CAN_NBTP = 2u << 25 | 9u << 16 | 12u << 8 | 2u; /* 170 MHz / 10 / 17 */
    CAN_RXGFC = 3u | 2u << 2; /* no remote frames, none of 29 bits; all others into FIFO 0 */
    CAN_IE = 1u;
    CAN_ILE = 1u;
    enable_interrupt(CAN_INTERRUPT);
    CAN_CCCR &= ~1u;
    while (CAN_CCCR & 1u)
        ;
}

bool chip_send(const struct frame *frame)
{
    uint32_t words[2], status = CAN_TXFQS;
    unsigned number = status >> 16 & 3u;

    if ((status & 7u) == 0)
        return false;
    memcpy(words, frame->data, sizeof words);
    SENT(number, 0) = (uint32_t)frame->id << 18;
    SENT(number, 1) = (uint32_t)frame->length << 16;
    SENT(number, 2) = words[0];
    SENT(number, 3) = words[1];
    CAN_TXBAR = 1u << number;
    return true;
}

void on_can(void)
{
    CAN_IR = 1u;
    while (CAN_RXF0S & 0xFu) {
        unsigned number = CAN_RXF0S >> 8 & 3u;
        uint32_t words[2] = {RECEIVED(number, 2), RECEIVED(number, 3)};
        struct frame frame = {.id = (uint16_t)(RECEIVED(number, 0) >> 18 & 0x7FFu),
                              .length = RECEIVED(number, 1) >> 16 & 0xFu};

        memcpy(frame.data, words, sizeof words);
        CAN_RXF0A = number;
        keep_frame(&frame);
    }
}
