/* A port of the firmware to a board with an AK80-6, the motor of the bill of materials.
 * NO BOARD HAS RUN IT. Try it with the machine hung up and a switch in the battery's lead.
 *
 *     python -m agents.export pretrained:onboard --to firmware --name walker --out firmware
 *     cc -c -std=c99 -Ifirmware workshop/firmware/ak80_6.c firmware/walker_firmware.c
 *
 * Pins, as on a NUCLEO-F446RE:
 *     CAN1   PB8 RX, PB9 TX, through a transceiver; 1 Mbit/s, the motor in MIT mode, ID 1
 *     SPI1   PA5 to PA7, CS PA4: AS5048A, 14 bits, its magnet on the crankshaft
 *     SPI2   PB13 to PB15, CS PB12: ICM-42688-P at the crank axis, read at 1 kHz
 *     ADC1   PA0: battery by 100 and 12 kohm
 *     IWDG   60 ms; TIM6 calls jansen_watchdog each 10 ms */
#include <math.h>
#include <stdint.h>

#include "steady.h"
#include "walker_firmware.h"

#define MOTOR_ID 1
#define TORQUE_RANGE 12.0f /* N m, of 12 bits; DFKI's driver has it of versions 1.1 and 2 */
#define COUNTS 16384       /* of the encoder in a turn */
#define ZERO 0             /* count at which the first leg's crank pin points along the chassis' +x */
#define DIRECTION 1        /* -1 if counts fall while the machine walks forwards */
#define TURN 6.283185307179586 /* rad */

/* What a board has to give. Each returns 0 if nothing came since the last call. */
int can_send(uint32_t id, const uint8_t data[8]);
int can_receive(uint8_t data[6]);          /* the motor's answer */
int encoder_read(uint16_t *count);         /* 0 to COUNTS - 1, parity checked */
int imu_means(float *pitch_rate, float *x, float *y); /* of all samples since the last call, SI */
float battery_voltage(void);
float commanded_speed(void);      /* m/s; 0 to stand */
float constant_crank_speed(void); /* rad/s, by steady.h; 0 to walk by the policy */
float seconds(void);              /* between two calls; measured */
void watchdog_kick(void);

static const struct steady_gains GAINS = { 10.0f, 1.0f, 1.0f, TORQUE_RANGE };
static struct steady steady;

/* A command of MIT mode: position and speed 0 with gains 0, and a torque. */
void torque_frame(float torque, uint8_t data[8])
{
    const float share = (torque + TORQUE_RANGE) / (2.0f * TORQUE_RANGE);
    const uint16_t bits = (uint16_t)(fminf(fmaxf(share, 0.0f), 1.0f) * 4095.0f + 0.5f);
    const uint8_t zero[6] = { 0x7F, 0xFF, 0x7F, 0xF0, 0x00, 0x00 };
    int i;

    for (i = 0; i < 6; ++i) {
        data[i] = zero[i];
    }
    data[6] = (uint8_t)(bits >> 8);
    data[7] = (uint8_t)(bits & 0xFF);
}

/* Torque, N m, of an answer: ID, position (16 bits), speed (12) and torque (12). */
float answered_torque(const uint8_t data[6])
{
    const unsigned bits = (unsigned)(data[4] & 0x0F) << 8 | data[5];

    return ((float)bits / 4095.0f * 2.0f - 1.0f) * TORQUE_RANGE;
}

/* A control period: sends the torque that was worked out in the last one, so that the delay is
 * the same each time, and works out the next. */
void control_period(struct jansen *machine, float *torque)
{
    const float constant = constant_crank_speed();
    struct jansen_sensors now;
    uint8_t frame[8], answer[6];
    uint16_t count;

    torque_frame(*torque, frame);
    (void)can_send(MOTOR_ID, frame); /* if it fails, no answer comes */
    now.period = seconds();
    now.speed_command = constant > 0.0f ? JANSEN_SLOWEST : commanded_speed();
    now.crank_angle = NAN;
    if (encoder_read(&count)) {
        now.crank_angle = DIRECTION * ((int)count - ZERO) * (TURN / COUNTS);
    }
    if (!imu_means(&now.pitch_rate, &now.acceleration_x, &now.acceleration_y)) {
        now.pitch_rate = NAN;
    }
    now.crank_torque = can_receive(answer) ? answered_torque(answer) : NAN;
    now.battery = battery_voltage();
    *torque = jansen_step(machine, &now);
    if (constant > 0.0f && machine->begun && machine->fault == JANSEN_FINE) {
        *torque = steady_torque(
            &steady, &GAINS, constant, now.crank_angle, machine->crank_speed, now.period);
        machine->action = *torque / JANSEN_TORQUE_LIMIT; /* by which faults are found */
        torque_frame(*torque, frame); /* at once: a period late, the built robot is unstable */
        (void)can_send(MOTOR_ID, frame);
    } else {
        steady = (struct steady){ 0 };
    }
    watchdog_kick();
}
