/* Runs firmware on a Cortex-M or a RISC-V of QEMU, whose clock counts instructions; prints: ticks of a step
 * at most, ticks of 200,000 instructions, bytes of stack, the fault, the last torque in mN m. */
#include <stdint.h>

#include "mine_firmware.h"

#define STACK 4096 /* bytes, that are watched */
extern uint32_t stack_top;

#ifdef __riscv
static uint32_t ticks(void) /* downwards */
{
    uint32_t counted;
    __asm__ volatile(".option push\n.option arch, +zicsr\ncsrr %0, minstret\n.option pop"
                     : "=r"(counted));
    return 0U - counted;
}

static void host(uint32_t operation, const void *argument)
{
    register uint32_t a0 __asm__("a0") = operation;
    register const void *a1 __asm__("a1") = argument;
    __asm__ volatile(".option push\n.option norvc\n.balign 16\nslli x0, x0, 0x1f\nebreak\n"
                     "srai x0, x0, 7\n.option pop" : "+r"(a0) : "r"(a1) : "memory");
}

static void start_ticks(void)
{
}
#define LOOP "1: addi %0, %0, -1\n bnez %0, 1b"
#else
#define CONTROL (*(volatile uint32_t *)0xE000E010) /* of SysTick */
#define RELOAD (*(volatile uint32_t *)0xE000E014)
#define TICKS (*(volatile uint32_t *)0xE000E018)

static uint32_t ticks(void)
{
    return TICKS;
}

static void host(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

static void start_ticks(void)
{
    RELOAD = 0xFFFFFF;
    TICKS = 0;
    CONTROL = 5;
}
#define LOOP ".syntax unified\n1: subs %0, %0, #1\n bne 1b"
#endif

static void print(uint32_t number)
{
    char text[12];
    int k = 11;

    text[k] = 0;
    text[--k] = '\n';
    do {
        text[--k] = (char)('0' + number % 10);
        number /= 10;
    } while (number);
    host(4, text + k);
}

__attribute__((noinline)) void run(void)
{
    volatile uint32_t *unused = &stack_top - STACK / 4;
    struct jansen_sensors now = { JANSEN_CONTROL_PERIOD, 0.3f, 0, 0, 0, 9.81f, 0, 24 };
    struct jansen j;
    uint32_t most = 0, k, before, took, loops = 100000;
    float torque = 0;

    for (k = 0; k < STACK / 4 - 128; ++k) {
        unused[k] = 0xA5A5A5A5;
    }
    start_ticks();
    jansen_init(&j);
    for (k = 0; k < 100; ++k) {
        now.crank_angle += 0.06f;
        before = ticks();
        torque = jansen_step(&j, &now);
        took = (before - ticks()) & 0xFFFFFF;
        most = took > most ? took : most;
    }
    before = ticks();
    __asm__ volatile(LOOP : "+r"(loops) : : "cc");
    took = (before - ticks()) & 0xFFFFFF;
    for (k = 0; unused[k] == 0xA5A5A5A5; ++k) {
    }
    print(most);
    print(took);
    print(STACK - 4 * k);
    print((uint32_t)j.fault);
    print((uint32_t)(1000.0f * (torque < 0 ? -torque : torque)));
    host(0x18, (void *)0x20026);
}

#ifdef __riscv
__attribute__((naked, section(".vectors"), used)) void reset(void)
{
    __asm__ volatile("la sp, stack_top\n call run");
}
#else
void reset(void)
{
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* floating point unit, if there is one */
    run();
}

__attribute__((section(".vectors"), used)) const void *vectors[] = { &stack_top, (void *)reset };
#endif
