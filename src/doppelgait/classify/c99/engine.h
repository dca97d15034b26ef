/* A trained network of tracks of doppelgait: from complex range bins to an alarm.

   C99, no allocation, nothing but <math.h> and <stdint.h>. Made by `doppelgait model export --form c`.
   Not re-entrant: work memory is static. One thread at a time, for however many radars. */
#ifndef DOPPELGAIT_MODEL_H
#define DOPPELGAIT_MODEL_H

#include <stdint.h>

/* @MACROS@ */

extern const char *const dg_class_names[DG_CLASSES];

/* What the network remembers of a track. All zeros: nothing. */
typedef struct {
    float total[DG_MEMORY], weight[DG_MEMORY];
    int32_t count;
} dg_memory;

typedef struct {
    float probability[DG_CLASSES];             /* calibrated, for equally frequent classes; of the track up to now */
    int label;                                 /* most likely class */
    int decided;                               /* 0: no target, or the probability is below DG_ABSTAIN_BELOW */
    int alarm;                                 /* 1 from the second window in succession on that reaches the threshold */
    float range_m, approach_mps;               /* of the target; approaching is positive */
} dg_decision;

/* One radar, and the one target that it follows: the strongest that moves. */
typedef struct {
    float ring[DG_BINS][DG_CPI][2];            /* pulses of one processing interval */
    float first[DG_BINS][2];                   /* first pulse; small numbers then keep all digits */
    float still[DG_BINS][2];                   /* running mean of every bin less that */
    float energy[DG_BINS], moment[DG_BINS];    /* power above the noise of one column, and times velocity */
    float columns[DG_COLUMNS][DG_VELOCITIES][DG_SLICES];
    float approach[DG_COLUMNS];
    unsigned char found[DG_COLUMNS];           /* whether the target was found in a column */
    dg_decision last;
    float power, noise, range_m, approach_mps; /* mean power of a pulse, and noise of a cell; the target */
    uint32_t pulses;                           /* since dg_start, up to the time constant of the mean */
    int place, wait, part;                     /* next pulse of the ring, pulses to the next transform, its number */
    int spikes, follows, age, lost, since;     /* a target is followed; columns with it, without echo, since a window */
    int due, reached, alarm;
    dg_memory memory;
} dg_radar;

/* Begin anew: after the start, and after lost pulses. */
void dg_start(dg_radar *radar);

/* Take one pulse: real and imaginary part of every range bin, interleaved (2 * DG_BINS). A sample that is not finite is
   taken as no echo. Returns 1 when a decision is due: every DG_HOP_COLUMNS columns of DG_COLUMN_S, and when the target is
   lost. */
int dg_push(dg_radar *radar, const float *samples);

/* Decide about the followed target. Before it was seen for a window, nothing is decided. */
void dg_decide(dg_radar *radar, dg_decision *decision);

/* Add one picture (DG_TIMES, DG_VELOCITIES, DG_SLICES), levels 0 to 1, to a memory. since_s is the time since the end
   of the window before, 0 for the first. Range, speed and alarm of the decision stay as they are. */
void dg_follow(dg_memory *memory, const float *picture, float since_s, dg_decision *decision);

#endif
