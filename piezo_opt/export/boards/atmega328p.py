"""The ATmega328P of an Arduino Uno: 8 bits, no floating point, 32 KiB of flash, 2 KiB of RAM.

Simulated by simavr, which counts cycles. The program answers over the serial port and measures its
stack by what it has overwritten of a pattern. Datasheet: Microchip (2018), DS40002061A.
"""

from __future__ import annotations

from typing import Final

from piezo_opt.export.boards.board import Board

_AROUND: Final = """
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include <stdint.h>

extern uint8_t _end;
static {n} one;
static volatile uint16_t wraps;
ISR(TIMER1_OVF_vect) {{ ++wraps; }}

static void put(char c)
{{
    while (!(UCSR0A & (1 << UDRE0))) {{ }}
    UDR0 = (uint8_t)c;
}}

/* Cycles: the first timer counts every one. */
static uint32_t now(void)
{{
    uint16_t count, turns;
    cli();
    count = TCNT1;
    turns = wraps;
    if ((TIFR1 & (1 << TOV1)) && count < 0x8000) ++turns;
    sei();
    return ((uint32_t)turns << 16) | count;
}}

static void begin(void)
{{
    uint8_t *p = &_end;
    while ((uint16_t)p + 8 < SP) *p++ = 0xc5;
    UCSR0B = 1 << TXEN0;
    UBRR0 = 0;
    TCCR1B = 1 << CS10;
    TIMSK1 = 1 << TOIE1;
    sei();
}}

/* Bytes of the stack that have been used. */
static uint32_t deepest(void)
{{
    const uint8_t *p = &_end;
    while (*p == 0xc5) ++p;
    return (uint32_t)(RAMEND - (uint16_t)p + 1);
}}

static void end(void)
{{
    while (!(UCSR0A & (1 << TXC0))) {{ }}
    cli();
    sleep_enable();
    sleep_cpu();
}}
{table}
static float at(int row, int column) {{ return pgm_read_float(&rows[row][column]); }}
{write}
static void show(float value)
{{
    union {{ float f; uint32_t u; }} both;
    both.f = value;
    {n}_write(both.u);
}}
"""

BOARD: Final = Board(
    name="atmega328p",
    told="ATmega328P at 16 MHz (Arduino Uno), simavr",
    counts="cycles",
    packages=("gcc-avr", "avr-libc", "simavr"),
    compiler="avr-gcc",
    size="avr-size",
    flags=(
        "-std=gnu99", "-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os", "-ffunction-sections",
        "-fdata-sections",
    ),
    startup="",
    around=_AROUND,
    table="static const float rows[][{columns}] PROGMEM = {{{values}}};",
    support=(),
    linked=("-Wl,--gc-sections",),
    runner=("simavr", "-m", "atmega328p", "-f", "16000000"),
)  # fmt: skip
