#include "doppelgait_model.h"

#include <math.h>

typedef struct {
    const dg_weight *kernel; /* (n_out, 3, 3, n_in) */
    const float *scale, *bias;
    int n_in, n_out;
} dg_layer;

/* @TABLES@ */

static float layer_even[DG_EVEN_VALUES], layer_odd[DG_ODD_VALUES];
static float spectrum[2][DG_DOPPLER][2];
static float power[DG_BINS][DG_DOPPLER];

static void fill_zero(float *values, int n)
{
    while (n > 0)
        values[--n] = 0.0f;
}

static void log_softmax(float *scores)
{
    float highest = scores[0], sum = 0.0f;
    int k;
    for (k = 1; k < DG_CLASSES; k++)
        highest = scores[k] > highest ? scores[k] : highest;
    for (k = 0; k < DG_CLASSES; k++)
        sum += expf(scores[k] - highest);
    for (k = 0; k < DG_CLASSES; k++)
        scores[k] -= highest + logf(sum);
}

/* One convolution 3 x 3 with a border of zeros, maximum of 2 x 2, scale, bias, rectifier. */
static void compute_layer(const dg_layer *own, const float *in, int height, int width, float *out)
{
    int y, x, corner, o, ky, kx, i;
    for (y = 0; y < height / 2; y++)
        for (x = 0; x < width / 2; x++)
            for (o = 0; o < own->n_out; o++) {
                float best = 0.0f;
                for (corner = 0; corner < 4; corner++) {
                    float sum = 0.0f;
                    for (ky = 0; ky < 3; ky++) {
                        int row = 2 * y + corner / 2 + ky - 1;
                        if (row < 0 || row >= height)
                            continue;
                        for (kx = 0; kx < 3; kx++) {
                            int place = 2 * x + corner % 2 + kx - 1;
                            const dg_weight *k = own->kernel + ((o * 3 + ky) * 3 + kx) * own->n_in;
                            for (i = 0; place >= 0 && place < width && i < own->n_in; i++)
                                sum += in[(row * width + place) * own->n_in + i] * (float)k[i];
                        }
                    }
                    if (corner == 0 || sum > best)
                        best = sum;
                }
                best = best * own->scale[o] + own->bias[o];
                out[(y * (width / 2) + x) * own->n_out + o] = best > 0.0f ? best : 0.0f;
            }
}

/* out = weight (n_out, n_in) * in + bias, cut at 0 if it is a layer of a network. */
static void multiply(const float *weight, const float *bias, const float *in, int n_in, float *out, int n_out, int cut)
{
    int o, i;
    for (o = 0; o < n_out; o++) {
        float sum = bias[o];
        for (i = 0; i < n_in; i++)
            sum += weight[o * n_in + i] * in[i];
        out[o] = cut && sum < 0.0f ? 0.0f : sum;
    }
}

void dg_follow(dg_memory *memory, const float *picture, float since_s, dg_decision *decision)
{
    float pooled[2 * DG_CHANNELS], inputs[DG_EMBEDDING + 2], gate[DG_MEMORY], value[DG_MEMORY];
    float summary[3 * DG_MEMORY], hidden[DG_HIDDEN], answer[DG_CLASSES];
    const float *in = picture;
    float *out = layer_odd, *other = layer_even;
    int n, k, i, height = DG_TIMES, width = DG_VELOCITIES;
    for (n = 0; n < DG_LAYERS; n++) {
        compute_layer(&layers[n], in, height, width, out);
        in = out;
        out = other;
        other = (float *)in;
        height /= 2;
        width /= 2;
    }
    fill_zero(pooled, 2 * DG_CHANNELS);
    for (i = 0; i < height * width; i++)
        for (k = 0; k < DG_CHANNELS; k++) {
            float one = in[i * DG_CHANNELS + k];
            pooled[k] += one / (float)(height * width);
            if (one > pooled[DG_CHANNELS + k])
                pooled[DG_CHANNELS + k] = one;
        }
    multiply(embed_weight, embed_bias, pooled, 2 * DG_CHANNELS, inputs, DG_EMBEDDING, 1);
    inputs[DG_EMBEDDING] = since_s < DG_LONGEST_S ? since_s : DG_LONGEST_S;
    inputs[DG_EMBEDDING + 1] = logf((float)memory->count + 1.0f);
    multiply(gate_weight, gate_bias, inputs, DG_EMBEDDING + 2, gate, DG_MEMORY, 0);
    multiply(value_weight, value_bias, inputs, DG_EMBEDDING + 2, value, DG_MEMORY, 0);
    for (k = 0; k < DG_MEMORY; k++) {
        float kept = expf(-since_s * forgetting_hz[k]), weight = gate[k];
        weight = weight < -DG_MOST_LOG ? -DG_MOST_LOG : weight > DG_MOST_LOG ? DG_MOST_LOG : weight;
        weight = expf(weight);
        memory->weight[k] = kept * memory->weight[k] + weight;
        memory->total[k] = kept * memory->total[k] + weight * value[k];
        summary[k] = memory->total[k] / memory->weight[k];
        summary[DG_MEMORY + k] = logf(memory->weight[k]);
        summary[2 * DG_MEMORY + k] = memory->total[k] / DG_SCALE;
    }
    if (memory->count < INT32_MAX)
        memory->count++;
    multiply(hidden_weight, hidden_bias, summary, 3 * DG_MEMORY, hidden, DG_HIDDEN, 1);
    multiply(last_weight, last_bias, hidden, DG_HIDDEN, answer, DG_CLASSES, 0);
    log_softmax(answer);
    for (k = 0; k < DG_CLASSES; k++)
        answer[k] = DG_SLOPE * answer[k] + calibration_shift[k];
    log_softmax(answer);
    decision->label = 0;
    for (k = 0; k < DG_CLASSES; k++) {
        decision->probability[k] = expf(answer[k]);
        if (answer[k] > answer[decision->label])
            decision->label = k;
    }
    decision->decided = decision->probability[decision->label] >= DG_ABSTAIN_BELOW;
}

/* Fourier transform of spectrum[0], whose length is a power of two, by Stockham's algorithm; returns where it is. */
static float (*transform(void))[2]
{
    int m, stride, which = 0;
    for (m = DG_DOPPLER / 2, stride = 1; m > 0; m /= 2, stride *= 2, which = 1 - which) {
        float(*in)[2] = spectrum[which], (*out)[2] = spectrum[1 - which];
        int j, q;
        for (j = 0; j < m; j++)
            for (q = 0; q < stride; q++) {
                const float *a = in[q + stride * j], *b = in[q + stride * (j + m)], *turn = turns[j * stride];
                float *sum = out[q + 2 * stride * j], *other = out[q + stride * (2 * j + 1)];
                float re = a[0] - b[0], im = a[1] - b[1];
                sum[0] = a[0] + b[0];
                sum[1] = a[1] + b[1];
                other[0] = re * turn[0] + im * turn[1];
                other[1] = im * turn[0] - re * turn[1];
            }
    }
    return spectrum[which];
}

static void forget(dg_decision *decision)
{
    int k;
    decision->decided = decision->label = 0;
    for (k = 0; k < DG_CLASSES; k++)
        decision->probability[k] = 1.0f / DG_CLASSES;
}

void dg_start(dg_radar *radar)
{
    unsigned char *bytes = (unsigned char *)radar;
    unsigned long n;
    for (n = 0; n < sizeof *radar; n++)
        bytes[n] = 0;
    radar->wait = DG_CPI;
    forget(&radar->last);
}

/* Begin to follow a target: nothing is known of it. */
static void begin(dg_radar *radar, float range_m, float approach_mps)
{
    static const dg_memory nothing;
    radar->range_m = range_m;
    radar->approach_mps = approach_mps;
    radar->memory = nothing;
    radar->follows = 1;
    radar->age = radar->lost = radar->since = radar->reached = radar->alarm = 0;
    forget(&radar->last);
}

/* Power of all bins, and the mean noise of a cell, by the third of the rows with the least power. */
static void transform_bins(dg_radar *radar)
{
    float rows[DG_DOPPLER], sum = 0.0f;
    int b, m, k, n = 0;
    fill_zero(rows, DG_DOPPLER);
    for (b = 0; b < DG_BINS; b++) {
        float(*found)[2];
        fill_zero(&spectrum[0][0][0], 2 * DG_DOPPLER);
        for (m = 0; m < DG_CPI; m++) {
            const float *pulse = radar->ring[b][(radar->place + m) % DG_CPI];
            spectrum[0][m][0] = taper[m] * pulse[0];
            spectrum[0][m][1] = taper[m] * pulse[1];
        }
        found = transform();
        for (k = 0; k < DG_DOPPLER; k++) { /* rows rise from the most negative Doppler frequency */
            const float *z = found[(k - DG_DOPPLER / 2 + DG_DOPPLER) % DG_DOPPLER];
            power[b][k] = z[0] * z[0] + z[1] * z[1];
            rows[k] += power[b][k] / DG_BINS;
        }
    }
    for (k = 1; k < DG_DOPPLER; k++) {
        float value = rows[k];
        for (m = k; m > 0 && rows[m - 1] > value; m--)
            rows[m] = rows[m - 1];
        rows[m] = value;
    }
    for (k = 0; k < DG_DOPPLER && n < DG_DOPPLER / 3; k++)
        if (rows[k] > 0.0f) {
            sum += rows[k];
            n++;
        }
    sum = n ? sum / (float)n / DG_NOISE_BIAS : 0.0f;
    radar->noise += radar->noise > 0.0f ? DG_NOISE_SHARE * (sum - radar->noise) : sum;
}

/* Share of a bin's cell between two ranges. */
static float overlap(int bin, float low_m, float high_m)
{
    float low = fmaxf((low_m - DG_FIRST_M) / DG_BIN_M + 0.5f - (float)bin, 0.0f);
    float high = fminf((high_m - DG_FIRST_M) / DG_BIN_M + 0.5f - (float)bin, 1.0f);
    return fmaxf(high - low, 0.0f);
}

/* Add the power in slices along range about the target, at velocities about its own. */
static void add_slices(dg_radar *radar, float (*column)[DG_SLICES])
{
    const float half_mps = 0.5f * DG_ROW_MPS * DG_DOPPLER;
    int slice, b, k, c;
    for (slice = 0; slice < DG_SLICES; slice++) {
        float low_m = radar->range_m + ((float)(slice - DG_SLICES / 2) - 0.5f) * DG_SLICE_M, high_m = low_m + DG_SLICE_M;
        float summed[DG_DOPPLER + 1], width = 0.0f, before = 0.0f;
        fill_zero(summed, DG_DOPPLER + 1);
        for (b = 0; b < DG_BINS; b++) {
            float share = overlap(b, low_m, high_m);
            width += share;
            for (k = 0; share > 0.0f && k < DG_DOPPLER; k++)
                summed[k + 1] += share * power[b][k];
        }
        for (k = 0; k < DG_DOPPLER; k++) {
            float excess = summed[k + 1] > DG_SIGNIFICANT * width * radar->noise ? summed[k + 1] - width * radar->noise : 0.0f;
            summed[k + 1] = summed[k] + excess;
        }
        for (c = 0; c <= DG_VELOCITIES; c++) {
            float edge = DG_CELL_MPS * (float)(c - DG_VELOCITIES / 2), place, turns, here;
            edge = edge < -half_mps ? -half_mps : edge > half_mps ? half_mps : edge;
            place = (edge + radar->approach_mps + half_mps) / DG_ROW_MPS + 0.5f;
            turns = floorf(place / DG_DOPPLER);
            place -= turns * DG_DOPPLER;
            k = (int)place < DG_DOPPLER ? (int)place : DG_DOPPLER - 1;
            here = summed[k] + (place - (float)k) * (summed[k + 1] - summed[k]) + turns * summed[DG_DOPPLER];
            if (c > 0)
                column[c - 1][slice] += here - before > 0.0f ? here - before : 0.0f;
            before = here;
        }
    }
}

/* Find the strongest moving echo of a column, near the target if one is followed. Returns 0 without any. */
static int find_echo(const dg_radar *radar, float *range_m, float *approach_mps)
{
    float best = DG_LEAST_ENERGY * radar->noise;
    int b, m, found = 0;
    for (b = 0; b < DG_BINS; b++) {
        float energy = 0.0f, range = 0.0f, moment = 0.0f;
        if (radar->follows && fabsf(DG_FIRST_M + DG_BIN_M * (float)b - radar->range_m) > DG_REACH_M)
            continue;
        for (m = b - DG_BODY_BINS; m <= b + DG_BODY_BINS; m++)
            if (m >= 0 && m < DG_BINS) {
                energy += radar->energy[m];
                moment += radar->moment[m];
                range += radar->energy[m] * (DG_FIRST_M + DG_BIN_M * (float)m);
            }
        if (energy > best) {
            best = energy;
            *range_m = range / energy;
            *approach_mps = moment / energy;
            found = 1;
        }
    }
    return found;
}

/* End a column of 0.1 s: follow the target, find one, or lose it. Returns 1 when a decision is due. */
static int end_column(dg_radar *radar)
{
    float range_m = 0.0f, approach_mps = 0.0f;
    int b, found = find_echo(radar, &range_m, &approach_mps);
    radar->part = 0;
    for (b = 0; b < DG_BINS; b++)
        radar->energy[b] = radar->moment[b] = 0.0f;
    if (!radar->follows) {
        if (found)
            begin(radar, range_m, approach_mps);
        return 0;
    }
    radar->found[radar->age % DG_COLUMNS] = (unsigned char)found;
    radar->approach[radar->age % DG_COLUMNS] = radar->approach_mps;
    radar->age++;
    radar->lost = found ? 0 : radar->lost + 1;
    if (found) {
        radar->approach_mps += DG_BETA * (approach_mps - radar->approach_mps);
        radar->range_m += DG_ALPHA * (range_m - radar->range_m);
    }
    radar->range_m -= radar->approach_mps * DG_COLUMN_S;
    if (radar->lost > DG_MOST_LOST || (radar->age < DG_CONFIRM && radar->lost > 1)) {
        radar->follows = radar->alarm = 0;
        forget(&radar->last);
        return radar->age >= DG_CONFIRM;
    }
    radar->since++;
    if (radar->age >= 1 << 20) /* after a day; the place in the ring stays the same */
        radar->age -= (1 << 19) / (DG_COLUMNS * DG_HOP_COLUMNS) * (DG_COLUMNS * DG_HOP_COLUMNS);
    radar->due = radar->age >= DG_COLUMNS && (radar->age - DG_COLUMNS) % DG_HOP_COLUMNS == 0;
    return radar->due;
}

/* Add the power of one transform to the column. */
static void add_transform(dg_radar *radar)
{
    int b, k;
    for (b = 0; b < DG_BINS; b++)
        for (k = 0; k < DG_DOPPLER; k++) {
            int row = k - DG_DOPPLER / 2; /* about zero, the mean that is taken off remembers disturbances */
            if ((row < -1 || row > 1) && power[b][k] > DG_SIGNIFICANT * radar->noise) {
                radar->energy[b] += power[b][k] - radar->noise;
                radar->moment[b] += (power[b][k] - radar->noise) * DG_ROW_MPS * (float)row;
            }
        }
    if (radar->follows)
        add_slices(radar, radar->columns[radar->age % DG_COLUMNS]);
}

/* Return 1 for a pulse with much more power, beyond static echoes, than those before: a spike. */
static int is_spike(dg_radar *radar, const float *samples)
{
    float power_now = 0.0f, share = fmaxf(1.0f / (float)(radar->pulses + 1u), DG_POWER_SHARE);
    int b, part;
    for (b = 0; b < DG_BINS; b++)
        for (part = 0; part < 2; part++) {
            float value = samples[2 * b + part] - radar->first[b][part] - radar->still[b][part];
            power_now += isfinite(value) ? value * value : 0.0f;
        }
    if (radar->pulses >= DG_CPI && power_now > DG_SPIKE * radar->power && ++radar->spikes < DG_MOST_SPIKES)
        return 1;
    if (radar->spikes >= DG_MOST_SPIKES)
        radar->power = power_now; /* a new level */
    else if (radar->pulses > 0) /* the first pulse has the static echoes */
        radar->power += share * (power_now - radar->power);
    radar->spikes = 0;
    return 0;
}

int dg_push(dg_radar *radar, const float *samples)
{
    float share = fmaxf(1.0f / (float)(radar->pulses + 1u), DG_STILL_SHARE); /* first the mean of all pulses */
    int b, part, spike = is_spike(radar, samples);
    for (b = 0; b < DG_BINS; b++)
        for (part = 0; part < 2; part++) {
            float value = samples[2 * b + part];
            if (spike || !isfinite(value)) { /* or every later window would be lost with it */
                radar->ring[b][radar->place][part] = 0.0f;
                continue;
            }
            if (radar->pulses == 0)
                radar->first[b][part] = value;
            value -= radar->first[b][part];
            radar->still[b][part] += share * (value - radar->still[b][part]);
            value -= radar->still[b][part];
            radar->ring[b][radar->place][part] = value;
        }
    if (radar->pulses < 0xfffffffeu)
        radar->pulses++;
    radar->place = (radar->place + 1) % DG_CPI;
    if (--radar->wait > 0)
        return 0;
    radar->wait = DG_HOP;
    if (radar->follows && radar->part == 0)
        fill_zero(&radar->columns[radar->age % DG_COLUMNS][0][0], DG_VELOCITIES * DG_SLICES);
    transform_bins(radar);
    add_transform(radar);
    return ++radar->part == DG_HOPS_PER_COLUMN && end_column(radar);
}

/* Add the window that has ended to what is known of the target. */
static void add_window(dg_radar *radar)
{
    float *picture = layer_even, top = 0.0f, way = 0.0f;
    const float *cells = &radar->columns[0][0][0];
    int c, v, s, seen = 0, oldest = radar->age % DG_COLUMNS;
    radar->last.decided = 0;
    for (c = 0; c < DG_COLUMNS * DG_VELOCITIES * DG_SLICES; c++)
        top = cells[c] > top ? cells[c] : top;
    for (c = 0; c < DG_COLUMNS; c++) {
        seen += radar->found[c];
        way += radar->approach[c];
    }
    if (seen < DG_LEAST_FOUND || fabsf(way) > DG_MOST_MPS * DG_COLUMNS || !(top > 0.0f))
        return;
    fill_zero(picture, DG_TIMES * DG_VELOCITIES * DG_SLICES);
    for (c = 0; c < DG_COLUMNS; c++)
        for (v = 0; v < DG_VELOCITIES; v++)
            for (s = 0; s < DG_SLICES; s++) {
                float one = radar->columns[(oldest + c) % DG_COLUMNS][way < 0.0f ? DG_VELOCITIES - 1 - v : v][s];
                float level = one > 0.0f ? 1.0f + 10.0f * log10f(one / top) / DG_RANGE_DB : 0.0f;
                picture[(c * DG_VELOCITIES + v) * DG_SLICES + s] = level > 0.0f ? level : 0.0f;
            }
    dg_follow(&radar->memory, picture, radar->memory.count ? (float)radar->since * DG_COLUMN_S : 0.0f, &radar->last);
    radar->since = 0;
    c = radar->last.probability[DG_ALARM_CLASS] >= DG_ALARM_THRESHOLD;
    radar->alarm |= c && radar->reached;
    radar->reached = c;
}

void dg_decide(dg_radar *radar, dg_decision *decision)
{
    if (radar->due)
        add_window(radar);
    radar->due = 0;
    *decision = radar->last;
    decision->alarm = radar->alarm;
    decision->range_m = radar->range_m;
    decision->approach_mps = radar->approach_mps;
}
