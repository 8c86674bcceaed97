/* A PID controller that turns the crank at a constant speed, as for the first power-up and for
 * measurements: jansen_env.PID, with the gains of docs/workshop/measure.md. NO BOARD HAS RUN IT.
 * It detects no fault: call jansen_step first, see the ports in this folder. */
#ifndef STEADY_H
#define STEADY_H

#include <math.h>

struct steady_gains {
    float kp, ki, kd; /* N m/rad, N m/(rad s), N m s/rad */
    float limit;      /* N m */
};

/* Begin with { 0 }, and again after each stop. */
struct steady {
    double angle;   /* rad, the last reading */
    float error;    /* rad by which the crank is behind its reference */
    float integral; /* rad s */
    int begun;
};

/* The torque, N m, for a speed of the crank in rad/s; period: s since the last call. The angle may
 * count any number of turns. While the torque is at its limit, reference and integral wait. */
static inline float steady_torque(struct steady *state, const struct steady_gains *gains,
                                  float speed, double angle, float crank_speed, float period)
{
    const float turn = (float)remainder(angle - state->angle, 6.283185307179586);
    float error, integral, torque;

    if (!isfinite(angle)) {
        return 0.0f;
    }
    error = state->begun ? state->error + speed * period - turn : 0.0f;
    integral = state->integral + error * period;
    torque = gains->kp * error + gains->ki * integral + gains->kd * (speed - crank_speed);
    if (fabsf(torque) < gains->limit) {
        state->integral = integral;
    } else if (state->begun) {
        error -= speed * period;
    }
    state->error = error;
    state->angle = angle;
    state->begun = 1;
    return fmaxf(-gains->limit, fminf(gains->limit, torque));
}

#endif
