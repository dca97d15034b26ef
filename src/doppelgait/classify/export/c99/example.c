/* From the samples of a radar to an alarm: a line for every decision.

   cc -std=c99 -O2 example.c doppelgait_model.c -lm -o example && ./example < samples.bin

   Input are pulses of 2 * DG_BINS float32, real and imaginary part of every range bin. A radar with frequency sweeps
   gives samples of the beat signal instead: compile with -DSAMPLES=64 (complex samples of a sweep, with a window whose
   side lobes are low), and the range transform below makes the bins. */
#include "doppelgait_model.h"

#include <math.h>
#include <stdio.h>

#ifndef SAMPLES
#define SAMPLES 0
#endif

static dg_radar radar;
static dg_decision decision;
static float pulse[2 * DG_BINS];

#if SAMPLES
static float sweep[2 * SAMPLES];

static void transform_range(void)
{
    int b, n;
    for (b = 0; b < DG_BINS; b++) {
        double re = 0.0, im = 0.0;
        for (n = 0; n < SAMPLES; n++) {
            double turn = 6.283185307179586 * (double)((long)b * n % SAMPLES) / SAMPLES;
            re += sweep[2 * n] * cos(turn) + sweep[2 * n + 1] * sin(turn);
            im += sweep[2 * n + 1] * cos(turn) - sweep[2 * n] * sin(turn);
        }
        pulse[2 * b] = (float)re;
        pulse[2 * b + 1] = (float)im;
    }
}
#endif

static int read_pulse(void)
{
#if SAMPLES
    if (fread(sweep, sizeof sweep, 1, stdin) != 1)
        return 0;
    transform_range();
    return 1;
#else
    return fread(pulse, sizeof pulse, 1, stdin) == 1;
#endif
}

int main(void)
{
    unsigned long pulses = 0;
    dg_start(&radar);
    while (read_pulse()) {
        pulses++;
        if (!dg_push(&radar, pulse))
            continue;
        dg_decide(&radar, &decision);
        printf("%.2f s, %.2f m: %s %.3f%s\n", (double)pulses / DG_PRF_HZ, (double)decision.range_m,
               decision.decided ? dg_class_names[decision.label] : "-", (double)decision.probability[DG_ALARM_CLASS],
               decision.alarm ? ", alarm" : "");
    }
    return 0;
}
