"""Pieces of the C source that :mod:`agents.export_c` puts together; ``real`` is double or float."""

from __future__ import annotations

PRELUDE = """\
/* See {name}.h. */
#include "{name}.h"

#include <math.h>

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "-ffast-math leaves out the test for numbers that are not finite"
#endif

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
static void linear(const float *weight, const float *bias, int units, int inputs, const real *in,
                   real *out)
{
    int i, j;

    for (i = 0; i < units; ++i) {
        real sum = (real)bias[i];
        for (j = 0; j < inputs; ++j) {
            sum += (real)weight[i * inputs + j] * in[j];
        }
        out[i] = sum;
    }
}
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

STEP = """\
int {name}_step(const float observation[OBSERVATIONS], float *action)
{{
    real seen[OBSERVATIONS], x[{width}], y[{width}], value;
    int i;

    *action = 0.0f;
    for (i = 0; i < OBSERVATIONS; ++i) {{
        if (!isfinite(observation[i])) {{
            return -1;
        }}
        seen[i] = (real)observation[i];
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
/* Reads observations, numbers between spaces, and prints an action for each.
 * Compile: cc -std=c99 -O2 main.c {name}.c -lm */
#include <stdio.h>
#include <stdlib.h>

#include "{name}.h"

int main(void)
{{
    float observation[{upper}_OBSERVATIONS], action;
    char word[64], *end;
    int i = 0;

    while (scanf("%63s", word) == 1) {{
        observation[i++] = strtof(word, &end);
        if (*end != '\\0') {{
            fprintf(stderr, "%s is no number\\n", word);
            return 1;
        }}
        if (i == {upper}_OBSERVATIONS) {{
            i = 0;
            if ({name}_step(observation, &action) != 0) {{
                fputs("an observation is not finite\\n", stderr);
                return 1;
            }}
            printf("%.9g\\n", (double)action);
        }}
    }}
    if (i != 0) {{
        fprintf(stderr, "the last observation has %d of %d numbers\\n", i, {upper}_OBSERVATIONS);
        return 1;
    }}
    return 0;
}}
"""
