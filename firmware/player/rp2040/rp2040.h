/* The registers of an RP2040 that the port uses; names and numbers as in its data sheet.
 * SPDX-License-Identifier: MIT */
#ifndef RP2040_H
#define RP2040_H

#include <stddef.h>
#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))
#define SET(reg) (*(&(reg) + 0x2000 / 4)) /* what is written there sets, or clears, bits of the register */
#define CLR(reg) (*(&(reg) + 0x3000 / 4))

/* Flash, and the serial interface to it */
#define FLASH 0x10000000u
#define SSI_CTRLR0 REG(0x18000000)
#define SSI_CTRLR1 REG(0x18000004)
#define SSI_SSIENR REG(0x18000008)
#define SSI_SER REG(0x18000010)
#define SSI_BAUDR REG(0x18000014)
#define SSI_SPI_CTRLR0 REG(0x180000F4)

/* Clocks, resets, watchdog, timer */
#define CLK_REF_CTRL REG(0x40008030)
#define CLK_REF_SELECTED REG(0x40008038)
#define CLK_SYS_CTRL REG(0x4000803C)
#define CLK_SYS_SELECTED REG(0x40008044)
#define CLK_PERI_CTRL REG(0x40008048)
#define RESETS_RESET REG(0x4000C000)
#define RESETS_DONE REG(0x4000C008)
#define PSM_WDSEL REG(0x40010008)
#define XOSC_CTRL REG(0x40024000)
#define XOSC_STATUS REG(0x40024004)
#define XOSC_STARTUP REG(0x4002400C)
#define PLL_SYS_CS REG(0x40028000)
#define PLL_SYS_PWR REG(0x40028004)
#define PLL_SYS_FBDIV REG(0x40028008)
#define PLL_SYS_PRIM REG(0x4002800C)
#define TIMER_RAWL REG(0x40054028)
#define WATCHDOG_CTRL REG(0x40058000)
#define WATCHDOG_LOAD REG(0x40058004)
#define WATCHDOG_TICK REG(0x4005802C)
enum {
    RESET_IO_BANK0 = 1 << 5, RESET_PADS_BANK0 = 1 << 8, RESET_PLL_SYS = 1 << 12, RESET_PWM = 1 << 14,
    RESET_SPI0 = 1 << 16, RESET_TIMER = 1 << 21, RESET_UART0 = 1 << 22
};

/* Pins */
#define GPIO_CTRL(n) REG(0x40014004 + 8 * (n))
#define IO_INTR0 REG(0x400140F0) /* four bits for each of the pins 0 to 7; the highest is the rising edge */
#define IO_INTE0 REG(0x40014100)
#define PAD(n) REG(0x4001C004 + 4 * (n))
#define GPIO_SET REG(0xD0000014)
#define GPIO_CLR REG(0xD0000018)
#define GPIO_OE_SET REG(0xD0000024)
enum { PIN_SPI = 1, PIN_UART = 2, PIN_SIO = 5, PAD_INPUT = 0x4A /* with a pull-up and a Schmitt trigger */ };

/* Serial lines */
#define UART_DR REG(0x40034000)
#define UART_FR REG(0x40034018)
#define UART_IBRD REG(0x40034024)
#define UART_FBRD REG(0x40034028)
#define UART_LCR_H REG(0x4003402C)
#define UART_CR REG(0x40034030)
enum { UART_RX_EMPTY = 1 << 4, UART_TX_FULL = 1 << 5, UART_FRAMING = 1 << 8, UART_OVERRUN = 1 << 11 };
#define SPI_CR0 REG(0x4003C000)
#define SPI_CR1 REG(0x4003C004)
#define SPI_DR REG(0x4003C008)
#define SPI_SR REG(0x4003C00C)
#define SPI_CPSR REG(0x4003C010)
enum { SPI_ENABLE = 2, SPI_NOT_EMPTY = 4, SPI_BUSY = 16 };

/* The counter that gives the points */
#define PWM_CSR REG(0x40050000)
#define PWM_DIV REG(0x40050004)
#define PWM_CTR REG(0x40050008)
#define PWM_TOP REG(0x40050010)
#define PWM_INTR REG(0x400500A4)
#define PWM_INTE REG(0x400500A8)

/* The processor */
#define NVIC_ISER REG(0xE000E100)
#define NVIC_IPR3 REG(0xE000E40C) /* IRQ 12 to 15 */
#define VTOR REG(0xE000ED08)
enum { IRQ_PWM = 4, IRQ_IO = 13 };

/* Runs with a clock of 125 MHz from the crystal; makes the ticks of the watchdog and of the timer. */
void start_clocks(void);

/* Takes parts of the processor out of reset. */
void release(uint32_t parts);

void *memset(void *to, int value, size_t n);
void *memcpy(void *to, const void *from, size_t n);
int main(void);
void on_pwm(void);
void on_io(void);

#endif
