/* Runs firmware on a Cortex-M of QEMU, whose clock counts instructions, and prints: ticks of a step
 * at most, ticks of 200,000 instructions, bytes of stack, the fault, the last torque in mN m. */
#include <stdint.h>

#include "mine_firmware.h"

#define STACK 4096 /* bytes, that are watched */
#define CONTROL (*(volatile uint32_t *)0xE000E010) /* of SysTick */
#define RELOAD (*(volatile uint32_t *)0xE000E014)
#define TICKS (*(volatile uint32_t *)0xE000E018)

extern uint32_t stack_top;

static void host(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

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

static __attribute__((noinline)) void run(void)
{
    volatile uint32_t *unused = &stack_top - STACK / 4;
    struct jansen_sensors now = { JANSEN_CONTROL_PERIOD, 0.3f, 0, 0, 0, 9.81f, 0, 24 };
    struct jansen j;
    uint32_t most = 0, k, before, took, loops = 100000;
    float torque = 0;

    for (k = 0; k < STACK / 4 - 128; ++k) {
        unused[k] = 0xA5A5A5A5;
    }
    RELOAD = 0xFFFFFF;
    TICKS = 0;
    CONTROL = 5;
    jansen_init(&j);
    for (k = 0; k < 100; ++k) {
        now.crank_angle += 0.06f;
        before = TICKS;
        torque = jansen_step(&j, &now);
        took = (before - TICKS) & 0xFFFFFF;
        most = took > most ? took : most;
    }
    before = TICKS;
    __asm__ volatile(".syntax unified\n1: subs %0, %0, #1\n bne 1b" : "+l"(loops) : : "cc");
    took = (before - TICKS) & 0xFFFFFF;
    for (k = 0; unused[k] == 0xA5A5A5A5; ++k) {
    }
    print(most);
    print(took);
    print(STACK - 4 * k);
    print((uint32_t)j.fault);
    print((uint32_t)(1000.0f * (torque < 0 ? -torque : torque)));
    host(0x18, (void *)0x20026);
}

void reset(void)
{
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* floating point unit, if there is one */
    run();
}

__attribute__((section(".vectors"), used)) const void *vectors[] = { &stack_top, (void *)reset };
