"""A Cortex-M4 with its single-precision unit, as QEMU's board mps2-an386 has it.

QEMU does not know cycles. With ``-icount shift=0`` every instruction takes one nanosecond of its
clock, from which the SysTick timer of 25 MHz counts one in forty; the program checks that on a loop
of known length. Semihosting carries the output. Source: Armv7-M Architecture Reference Manual, B3.
"""

from __future__ import annotations

from typing import Final

from piezo_opt.export.boards.board import Board

_STARTUP: Final = """
#include <stdint.h>

extern uint32_t _stack_top, _stack_low, _data_start, _data_end, _data_load, _bss_start, _bss_end;
int main(void);

void reset(void)
{{
    uint32_t *from = &_data_load, *to = &_data_start;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* the unit for floats is off at first */
    __asm volatile("dsb\\n isb");
    while (to < &_data_end) *to++ = *from++;
    for (to = &_bss_start; to < &_bss_end;) *to++ = 0;
    main();
}}

__attribute__((section(".vectors"), used)) static void *const vectors[] = {{
    &_stack_top, (void *)reset
}};

"""

_AROUND: Final = """
static {n} one;

static void host(int operation, const void *argument)
{{
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}}

static void put(char c) {{ host(3, &c); }}

/* Instructions: one in forty is seen. */
static uint32_t now(void)
{{
    volatile uint32_t *const clock = (uint32_t *)0xE000E018;
    return (0xffffff - *clock) * 40u;
}}

static void begin(void)
{{
    volatile uint32_t *const timer = (uint32_t *)0xE000E010;
    uint32_t *p = &_stack_low;
    const uint32_t *const here = (uint32_t *)__builtin_frame_address(0) - 16;
    while (p < here) *p++ = 0xc5c5c5c5u;
    timer[1] = 0xffffff;
    timer[2] = 0;
    timer[0] = 5;
}}

/* Bytes of the stack that have been used. */
static uint32_t deepest(void)
{{
    const uint32_t *p = &_stack_low;
    while (*p == 0xc5c5c5c5u) ++p;
    return (uint32_t)(&_stack_top - p) * 4;
}}

static void end(void) {{ host(0x18, (void *)0x20026); }}
{table}
static float at(int row, int column) {{ return rows[row][column]; }}
{write}
static void show(float value)
{{
    union {{ float f; uint32_t u; }} both;
    both.f = value;
    {n}_write(both.u);
}}
"""

_SCRIPT: Final = """\
MEMORY {
    flash (rx) : ORIGIN = 0, LENGTH = 4M
    ram (rwx) : ORIGIN = 0x20000000, LENGTH = 64K
}
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > flash
    .ARM.exidx : { *(.ARM.exidx*) } > flash
    _data_load = LOADADDR(.data);
    .data : { _data_start = .; *(.data*) . = ALIGN(4); _data_end = .; } > ram AT > flash
    .bss (NOLOAD) : { _bss_start = .; *(.bss*) *(COMMON) . = ALIGN(4); _bss_end = .; } > ram
    _stack_low = .;
    _stack_top = ORIGIN(ram) + LENGTH(ram);
}
"""

_FLAGS: Final = (
    "-std=gnu99", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2",
    "-ffunction-sections", "-fdata-sections",
)  # fmt: skip

BOARD: Final = Board(
    name="cortex-m4f",
    told="Cortex-M4F, QEMU",
    counts="instructions",
    packages=("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm"),
    compiler="arm-none-eabi-gcc",
    size="arm-none-eabi-size",
    flags=_FLAGS,
    startup=_STARTUP,
    around=_AROUND,
    table="static const float rows[][{columns}] = {{{values}}};",
    support=(("board.ld", _SCRIPT),),
    linked=("-nostartfiles", "-T", "board.ld", "-Wl,--gc-sections"),
    runner=(
        "qemu-system-arm", "-M", "mps2-an386", "-nographic", "-icount", "shift=0",
        "-semihosting-config", "enable=on,target=native", "-kernel",
    ),
)  # fmt: skip
