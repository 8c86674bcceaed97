/* A port of the firmware to an ESP32 board with the parts of the weekend robot's bill of materials.
 * NO BOARD HAS RUN IT. Try it with the machine hung up and the emergency stop in your hand.
 *
 *     python -m agents.export pretrained:weekend --to firmware --name weekend --out firmware
 *     cc -c -std=c99 -Ifirmware workshop/firmware/weekend_esp32.c firmware/weekend_firmware.c
 *
 * Pins of an ESP32 DevKit board; all but the motor's supply run on the regulator's 5 V or on 3.3 V:
 *     GPIO25   DRV8874 EN, by LEDC at 20 kHz; PMODE low: EN is the duty, PH the direction
 *     GPIO26   DRV8874 PH
 *     GPIO27   DRV8874 nSLEEP: low switches the bridge off
 *     GPIO34   ADC1 channel 6: DRV8874 CS, 1.1 V/A
 *     GPIO35   ADC1 channel 7: battery by 10 and 3.3 kohm; 12.6 V become 3.1 V
 *     GPIO32   encoder A, GPIO33 encoder B: each by 10 and 20 kohm, 5 V become 3.3 V; by PCNT
 *     GPIO14   Hall switch, open collector, 10 kohm to 3.3 V; falling edge
 *     GPIO21   SDA, GPIO22 SCL: MPU-6050, 4 g and 250 degrees/s, read at 1 kHz
 * A timer calls current_loop every millisecond, and another one jansen_watchdog every 10 ms; the
 * task watchdog resets the board after 60 ms without watchdog_kick. */
#include <math.h>
#include <stdint.h>

#include "steady.h"
#include "weekend_firmware.h"

#define COUNTS_PER_TURN 3591.84 /* of the crank: 48 x 74.83 */
#define HALL_ANGLE 0.0          /* rad of the crank when the magnet passes; measure it */
#define DIRECTION 1             /* -1 if counts fall while the machine walks forwards */
#define TORQUE_CONSTANT 0.824f  /* N m/A at the crank: stall, 7.1 kg cm at 0.9 A and 12 V */
#define RESISTANCE 13.3f        /* ohm: 12 V and 0.9 A at stall */
#define BACK_EMF 1.43f          /* V s/rad at the crank: 12 V, 75 rev/min, 60 mA without load */
#define GAIN 5.0f               /* V/A and, integrated, V/(A s), of the current loop */
#define RATE 1500.0f
#define LOOP 0.001f       /* s */
#define SENSE 1.1f        /* V/A */
#define DIVIDER 4.0303f   /* (10 + 3.3) / 3.3 */
#define TURN 6.2831853f   /* rad */
#define EXACT_TURN 6.283185307179586
#define GRAVITY 9.80665f  /* m/s^2 */
#define ACCELEROMETER (4.0f * GRAVITY / 32768.0f)
#define GYRO (250.0f / 32768.0f * TURN / 360.0f)

/* What a board has to give. Functions that return int return 0 if nothing came. */
int encoder_count(int32_t *count);
int hall_edge(int32_t *count);           /* the encoder's count at an edge since the last call */
int imu_means(float raw[3]);             /* gyro z, accelerometer x, y: means since the last call */
float adc_volts(int channel);            /* 6 or 7 of ADC1, calibrated */
void bridge(float duty, int awake);      /* -1 to 1 */
float commanded_speed(void);             /* m/s; 0 to stand */
float constant_crank_speed(void);        /* rad/s, by steady.h; 0 to walk by the policy */
float seconds(void);                     /* between two calls; measured */
void watchdog_kick(void);

static const struct steady_gains GAINS = { 1.0f, 0.1f, 0.1f, 0.35f };
static struct steady steady;
static int32_t zero;
static int zeroed;
static volatile float wanted_torque, crank_speed, volts, mean_current;
static float integral;

/* Angle of the crank in rad, not reduced to one turn, at a count of the encoder. zero_count is the
 * count when the magnet passes. A float would lose digits of the count in an hour's walk. */
double crank_angle(int32_t count, int32_t zero_count)
{
    return HALL_ANGLE + EXACT_TURN * (DIRECTION * (count - zero_count)) / COUNTS_PER_TURN;
}

/* Duty of the bridge that brings the motor's current, A, to that of a torque, N m. */
float motor_duty(float torque, float speed, float current, float battery, float *sum)
{
    const float wanted = torque / TORQUE_CONSTANT, off = wanted - current;
    const float feed = RESISTANCE * wanted + BACK_EMF * speed;
    float duty;

    if (battery < 6.0f) {
        *sum = 0.0f;
        return 0.0f;
    }
    duty = (feed + GAIN * off + *sum) / battery;
    if (fabsf(duty) < 1.0f) { /* else it would wind up */
        *sum += RATE * LOOP * off;
    }
    return fmaxf(-1.0f, fminf(1.0f, duty));
}

/* Each millisecond. CS has no sign: it is that of the duty. */
void current_loop(void)
{
    static float duty;
    const float current = copysignf(adc_volts(6) / SENSE, duty);

    mean_current += 0.05f * (current - mean_current); /* over some 20 ms */
    duty = motor_duty(wanted_torque, crank_speed, current, volts, &integral);
    bridge(duty, wanted_torque != 0.0f);
}

/* A control period, every 20 ms: applies the torque that was worked out in the last one, so that
 * the delay is the same each time, and works out the next. Before the first Hall edge the crank has
 * no angle: turn it by hand, or slowly by motor_duty, until this function returns 1. */
int control_period(struct jansen *machine, float *torque)
{
    const float constant = constant_crank_speed();
    struct jansen_sensors now;
    int32_t count;
    float raw[3];

    if (hall_edge(&count)) {
        if (!zeroed) {
            jansen_init(machine);
        }
        zero = count;
        zeroed = 1;
    }
    volts = adc_volts(7) * DIVIDER;
    if (!zeroed) {
        *torque = 0.0f;
        wanted_torque = 0.0f;
        watchdog_kick();
        return 0;
    }
    wanted_torque = *torque;
    now.period = seconds();
    now.speed_command = constant > 0.0f ? JANSEN_SLOWEST : commanded_speed();
    now.crank_angle = encoder_count(&count) ? crank_angle(count, zero) : (double)NAN;
    now.pitch_rate = now.acceleration_x = now.acceleration_y = NAN;
    if (imu_means(raw)) {
        now.pitch_rate = GYRO * raw[0];
        now.acceleration_x = ACCELEROMETER * raw[1];
        now.acceleration_y = ACCELEROMETER * raw[2];
    }
    now.crank_torque = TORQUE_CONSTANT * mean_current;
    now.battery = volts;
    *torque = jansen_step(machine, &now);
    crank_speed = machine->crank_speed;
    if (constant > 0.0f && machine->begun && machine->fault == JANSEN_FINE) {
        *torque = steady_torque(
            &steady, &GAINS, constant, now.crank_angle, machine->crank_speed, now.period);
        machine->action = *torque / JANSEN_TORQUE_LIMIT; /* by which faults are found */
        wanted_torque = *torque; /* at once: the gains are those of a loop without delay */
    } else {
        steady = (struct steady){ 0 };
    }
    watchdog_kick();
    return 1;
}
