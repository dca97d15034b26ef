/* The networks of a trained model of doppelgait: from complex samples of a gate to a class.

   C99, no allocation, nothing but <math.h> and <stdint.h>. Made by `doppelgait model export --form c`.
   Not re-entrant: the layers of the network share one static buffer. */
#ifndef DOPPELGAIT_MODEL_H
#define DOPPELGAIT_MODEL_H

#include <stdint.h>

/* @MACROS@ */

extern const char *const dg_class_names[DG_CLASSES];

/* Range bins that dg_push takes: -DDG_BINS=31 for more than the exported number. */
#ifndef DG_BINS
#define DG_BINS DG_EXPORTED_BINS
#endif

/* The observation of one gate. Its size is most of the memory that the model needs. */
typedef struct {
    float ring[DG_BINS][DG_CPI][2];            /* pulses of one processing interval */
    float first[DG_BINS][2];                   /* first pulse; small numbers then keep all digits */
    float still[DG_BINS][2], rest[DG_BINS][2]; /* running mean of every bin less that, and its rounding (Kahan) */
    float weight[DG_BINS];                     /* share of a bin inside the gate, 0 to 1 */
    float rows[DG_DOPPLER];                    /* power of every Doppler row */
    float cells[DG_COLUMNS][DG_VELOCITIES];    /* power, later levels 0 to 1 */
    uint32_t pulses;                           /* since dg_start, up to the time constant of the mean */
    int place, wait, column;
} dg_window;

typedef struct {
    float probability[DG_CLASSES];             /* calibrated, for equally frequent classes */
    int label;                                 /* most likely class */
    int decided;                               /* 0: no signal, or the probability is below DG_ABSTAIN_BELOW */
    float peak_over_floor_db;                  /* strongest cell, median over time, over the noise floor */
} dg_decision;

/* Begin anew: after the start, after lost pulses, and when the gate belongs to another target. All weights become 1. */
void dg_start(dg_window *window);

/* Take one pulse: real and imaginary part of every bin, interleaved (2 * DG_BINS). A sample that is not finite is taken
   as no echo. The weights in the window may be changed at any time, so that the gate follows a target. Returns 1 when
   DG_WINDOW_PULSES (then DG_STFT_COLUMNS * DG_HOP) pulses have made a whole window, else 0. */
int dg_push(dg_window *window, const float *samples);

/* Decide about a whole window and begin the next one. Work memory is static: one thread at a time, for however many
   windows. */
void dg_decide(dg_window *window, dg_decision *decision);

/* Decide about levels (DG_COLUMNS, DG_VELOCITIES), time first, 0 to 1; peak_over_floor_db stays as it is. */
void dg_decide_levels(const float *levels, dg_decision *decision);

#endif
