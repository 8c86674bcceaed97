"""Pieces of the C source that :mod:`agents.export_c` puts together; ``real`` is double or float."""

from __future__ import annotations

PRELUDE = """\
/* See {name}.h. */
#include "{name}.h"

#include <math.h>

#define OBSERVATIONS {upper}_OBSERVATIONS

#ifdef {upper}_SINGLE_PRECISION
typedef float real;
#define R(x) x##f
{single}#else
typedef double real;
#define R(x) x
{double}#endif
"""

CLIP = """\
static real clip(real x, real limit)
{
    return x < -limit ? -limit : x > limit ? limit : x;
}
"""

HARMONIC = """\
/* cos k psi and sin k psi from cos psi and sin psi, by squaring. */
static void harmonic(real c, real s, int k, real *out)
{
    real re = R(1.0), im = R(0.0), next;

    for (; k > 0; k /= 2) {
        if (k % 2 == 1) {
            next = re * c - im * s;
            im = re * s + im * c;
            re = next;
        }
        next = c * c - s * s;
        s = R(2.0) * c * s;
        c = next;
    }
    out[0] = re;
    out[1] = im;
}
"""

LINEAR = """\
static void linear_{kind}(const {kind} *weight, const {kind} *bias, int units, int inputs,
                         const real *in, real *out)
{{
    int i, j;

    for (i = 0; i < units; ++i) {{
        real sum = bias[i];
        for (j = 0; j < inputs; ++j) {{
            sum += (real)weight[i * inputs + j] * in[j];
        }}
        out[i] = sum;
    }}
}}
"""

ACTIVATIONS = {
    "tanh": "TANH(values[i])",
    "relu": "values[i] > R(0.0) ? values[i] : R(0.0)",
    "elu": "values[i] > R(0.0) ? values[i] : EXPM1(values[i])",
}
ACTIVATION = """\
static void {name}_all(real *values, int count)
{{
    int i;

    for (i = 0; i < count; ++i) {{
        values[i] = {value};
    }}
}}
"""

CRANK_SPEED = """\
/* The share of the torque limit: towards a crank speed that the action chooses. */
static real torque_share(const float *observation, real action)
{{
    real command = observation[{command}], speed = observation[{speed}];
    real target = command * {per_metre} * POW({span}, action);

    return clip({gain} * (target - speed) / {limit}, R(1.0));
}}
"""

RESIDUAL = """\
/* The share of the torque limit: a crank-speed profile's, to which the action adds. */
static real torque_share(const float *observation, real action)
{{
    real command = observation[{command}], sign = command < R(0.0) ? R(-1.0) : R(1.0);
    real size = sign * command, last = profile_commands[{last}];
    real inside = size < last ? size : last, share, shape, wanted, next;
    real c = observation[{cos}], s = observation[{sin}], re, im, p[{width}];
    real lag = observation[{lag}], speed = observation[{speed}];
    int i, k = 1;

    while (k < {last} && profile_commands[k] < inside) {{
        ++k;
    }}
    share = (inside - profile_commands[k - 1]) / (profile_commands[k] - profile_commands[k - 1]);
    for (i = 0; i < {width}; ++i) {{
        p[i] = (R(1.0) - share) * (real)profile_numbers[(k - 1) * {width} + i]
               + share * (real)profile_numbers[k * {width} + i];
    }}
    p[0] *= size > last ? size / last : R(1.0);
    shape = p[3] * sign * lag;
    c *= sign;
    re = c * c - s * s;
    im = R(2.0) * c * s;
    c = re;
    s = im;
    for (i = 0; i < {count}; ++i) {{
        shape += p[4 + i] * re + p[4 + {count} + i] * im;
        next = re * c - im * s;
        im = re * s + im * c;
        re = next;
    }}
    wanted = p[0] * EXP(shape);
    wanted = sign * (p[1] * (wanted - sign * speed) + p[2]);
    return clip(clip(wanted / {limit}, R(1.0)) + {share} * action, R(1.0));
}}
"""

REMEMBER = """\
/* What is seen: observations side by side, the present one first. */
static void remember({name}_state *state, const float *observation, real *seen)
{{
    int i, k, row;

    if (state->begun) {{
        state->newest = (state->newest + {steps} - 1) % {steps};
        for (i = 0; i < OBSERVATIONS; ++i) {{
            state->memory[state->newest][i] = observation[i];
        }}
    }} else {{ /* an episode's first observation stands for those before it */
        for (k = 0; k < {steps}; ++k) {{
            for (i = 0; i < OBSERVATIONS; ++i) {{
                state->memory[k][i] = observation[i];
            }}
        }}
        state->newest = 0;
        state->begun = 1;
    }}
    for (k = 0; k < {length}; ++k) {{
        row = (state->newest + k * {every}) % {steps};
        for (i = 0; i < OBSERVATIONS; ++i) {{
            seen[k * OBSERVATIONS + i] = state->memory[row][i];
        }}
    }}
}}
"""

STEP = """\
void {name}_reset({name}_state *state)
{{
    {reset}
}}

int {name}_step({name}_state *state, const float observation[OBSERVATIONS],
{indent}float *action)
{{
    real seen[{seen}], x[{width}], y[{width}], value;
    int i;

    *action = 0.0f;
    for (i = 0; i < OBSERVATIONS; ++i) {{
        if (!isfinite(observation[i])) {{
            return -1;
        }}
    }}
    {body}
    if (!isfinite(value)) {{
        return -1;
    }}
    *action = (float)value;
    return 0;
}}
"""

EXAMPLE = """\
/* Reads observations, numbers between spaces, and prints an action for each; the word reset begins
 * an episode. Compile: cc -std=c99 -O2 main.c {name}.c -lm */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "{name}.h"

int main(void)
{{
    {name}_state state;
    float observation[{upper}_OBSERVATIONS], action;
    char word[64];
    int i = 0;

    {name}_reset(&state);
    while (scanf("%63s", word) == 1) {{
        if (strcmp(word, "reset") == 0) {{
            {name}_reset(&state);
            continue;
        }}
        observation[i++] = strtof(word, NULL);
        if (i == {upper}_OBSERVATIONS) {{
            i = 0;
            if ({name}_step(&state, observation, &action) != 0) {{
                fputs("an observation is not finite\\n", stderr);
                return 1;
            }}
            printf("%.9g\\n", (double)action);
        }}
    }}
    return 0;
}}
"""
