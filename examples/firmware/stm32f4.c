/* STM32F407 at 168 MHz from a crystal of 8 MHz: bxCAN 1 on PB8 and PB9, USART2 on PA2 (RM0090). */
#include "stm32.h"

#include <string.h>

#define RCC 0x40023800u
#define RCC_CR REGISTER(RCC + 0x00)
#define RCC_PLLCFGR REGISTER(RCC + 0x04)
#define RCC_CFGR REGISTER(RCC + 0x08)
#define RCC_AHB1ENR REGISTER(RCC + 0x30)
#define RCC_APB1ENR REGISTER(RCC + 0x40)
#define FLASH_ACR REGISTER(0x40023C00u)
#define GPIOA 0x40020000u
#define GPIOB 0x40020400u
#define GPIO_MODER 0x00
#define GPIO_AFRL 0x20
#define GPIO_AFRH 0x24
#define USART2 0x40004400u
#define CAN 0x40006400u
#define CAN_MCR REGISTER(CAN + 0x00)
#define CAN_MSR REGISTER(CAN + 0x04)
#define CAN_TSR REGISTER(CAN + 0x08)
#define CAN_RF0R REGISTER(CAN + 0x0C)
#define CAN_IER REGISTER(CAN + 0x14)
#define CAN_BTR REGISTER(CAN + 0x1C)
#define CAN_TX(number, word) REGISTER(CAN + 0x180 + 16 * (number) + 4 * (word))
#define CAN_RX(word) REGISTER(CAN + 0x1B0 + 4 * (word))
#define CAN_FILTER(offset) REGISTER(CAN + 0x200 + (offset))
#define OF_IDE_AND_RTR 6u
#define TXRQ 1u
#define RFOM 32u

uint32_t chip_start(void)
{
    RCC_CR |= 1u << 16; /* the crystal */
    while (!(RCC_CR & 1u << 17))
        ;
    RCC_PLLCFGR = 8u | 336u << 6 | 1u << 22 | 7u << 24; /* 8 MHz / 8 * 336 / 2 */
    RCC_CR |= 1u << 24;
    while (!(RCC_CR & 1u << 25))
        ;
    FLASH_ACR = 5u;
    RCC_CFGR = 5u << 10 | 4u << 13 | 2u; /* APB1 42 MHz, its timers 84 MHz */
    while ((RCC_CFGR >> 2 & 3u) != 2u)
        ;
    RCC_AHB1ENR |= 3u;
    RCC_APB1ENR |= 1u | 1u << 17 | 1u << 25;
    REGISTER(GPIOA + GPIO_MODER) |= 2u << 4;
    REGISTER(GPIOA + GPIO_AFRL) |= 7u << 8;
    REGISTER(GPIOB + GPIO_MODER) |= 10u << 16;
    REGISTER(GPIOB + GPIO_AFRH) |= 0x99u;
    REGISTER(USART2 + 0x08) = 42000000u / 115200u;
    REGISTER(USART2 + 0x0C) = 1u << 13 | 1u << 3;
    return 84;
}

void chip_print(char byte)
{
    while (!(REGISTER(USART2) & 1u << 7))
        ;
    REGISTER(USART2 + 0x04) = (uint8_t)byte;
}

void chip_start_can(void)
{
    CAN_MCR = 1u | 1u << 6; /* initialisation; back from bus-off by itself */
    while (!(CAN_MSR & 1u))
        ;
    CAN_BTR = 2u << 20 | 9u << 16 | 2u; /* 42 MHz / 3 / 14 */
    CAN_FILTER(0x00) |= 1u;
    CAN_FILTER(0x0C) |= 1u; /* bank 0: one mask of 32 bits that lets all data frames of 11 bits in */
    CAN_FILTER(0x40) = 0;
    CAN_FILTER(0x44) = OF_IDE_AND_RTR;
    CAN_FILTER(0x1C) |= 1u;
    CAN_FILTER(0x00) &= ~1u;
    CAN_IER = 2u;
    enable_interrupt(CAN_INTERRUPT);
    CAN_MCR = 1u << 6;
    while (CAN_MSR & 1u)
        ;
}

bool chip_send(const struct frame *frame)
{
    uint32_t words[2], status = CAN_TSR;
    unsigned number = status >> 24 & 3u;

    if ((status & 7u << 26) != 7u << 26)
        return false; /* one after the other: so they keep their order */
    memcpy(words, frame->data, sizeof words);
    CAN_TX(number, 1) = frame->length;
    CAN_TX(number, 2) = words[0];
    CAN_TX(number, 3) = words[1];
    CAN_TX(number, 0) = (uint32_t)frame->id << 21 | TXRQ;
    return true;
}

void on_can(void)
{
    while (CAN_RF0R & 3u) {
        struct frame frame = {.id = (uint16_t)(CAN_RX(0) >> 21), .length = CAN_RX(1) & 0xFu};
        uint32_t words[2] = {CAN_RX(2), CAN_RX(3)};

        memcpy(frame.data, words, sizeof words);
        CAN_RF0R = RFOM;
        keep_frame(&frame);
    }
}
