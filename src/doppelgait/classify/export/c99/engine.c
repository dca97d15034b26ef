#include "doppelgait_model.h"

#include <math.h>

typedef struct {
    const dg_weight *kernel;                    /* (n_out, 3, 3, n_in) */
#if DG_INT8
    const int32_t *multiplier;                  /* activation = (sum * multiplier + offset) >> shift */
    const int64_t *offset;
    int shift;
#else
    const float *scale, *bias;
#endif
    int n_in, n_out;
} dg_layer;

typedef struct {
    const dg_layer *layers;
    const dg_weight *weight;                    /* (classes, n_last) */
    const float *scale, *bias;                  /* scale: of one unit of the sums, mean over the image included */
    float share, slope;                         /* of its answer among those of all networks, and its calibration */
    const float *shift;
} dg_network;

/* @TABLES@ */

static void fill_zero(float *values, int n)
{
    int k;
    for (k = 0; k < n; k++)
        values[k] = 0.0f;
}

static void log_softmax(float *scores)
{
    float highest = scores[0], sum = 0.0f;
    int k;
    for (k = 1; k < DG_CLASSES; k++)
        if (scores[k] > highest)
            highest = scores[k];
    for (k = 0; k < DG_CLASSES; k++)
        sum += expf(scores[k] - highest);
    for (k = 0; k < DG_CLASSES; k++)
        scores[k] -= highest + logf(sum);
}

/* Add weight * log_softmax(slope * answer + shift) to a total. */
static void add_calibrated(const float *answer, float slope, const float *shift, float weight, float *total)
{
    float scores[DG_CLASSES];
    int k;
    for (k = 0; k < DG_CLASSES; k++)
        scores[k] = slope * answer[k] + shift[k];
    log_softmax(scores);
    for (k = 0; k < DG_CLASSES; k++)
        total[k] += weight * scores[k];
}

#define DG_MOST(a, b) ((a) > (b) ? (a) : (b))
static dg_activation layer_even[DG_EVEN_VALUES], layer_odd[DG_ODD_VALUES];
static float spectrum[2][DG_DOPPLER][2];
static float sorted[DG_MOST(DG_DOPPLER, DG_COLUMNS)];

/* One convolution 3 x 3 with a border of zeros, maximum of 2 x 2, scale, bias, rectifier. */
static void layer_answer(const dg_layer *own, const dg_activation *in, int height, int width, dg_activation *out)
{
    int y, x, corner, o, ky, kx, i;
    for (y = 0; y < height / 2; y++)
        for (x = 0; x < width / 2; x++)
            for (o = 0; o < own->n_out; o++) {
                dg_sum best = 0;
                for (corner = 0; corner < 4; corner++) {
                    dg_sum sum = 0;
                    for (ky = 0; ky < 3; ky++) {
                        int row = 2 * y + corner / 2 + ky - 1;
                        if (row < 0 || row >= height)
                            continue;
                        for (kx = 0; kx < 3; kx++) {
                            int place = 2 * x + corner % 2 + kx - 1;
                            const dg_activation *a = in + (row * width + place) * own->n_in;
                            const dg_weight *k = own->kernel + ((o * 3 + ky) * 3 + kx) * own->n_in;
                            if (place < 0 || place >= width)
                                continue;
                            for (i = 0; i < own->n_in; i++)
                                sum += (dg_sum)a[i] * k[i];
                        }
                    }
                    if (corner == 0 || sum > best)
                        best = sum;
                }
#if DG_INT8
                {
                    int64_t value = (int64_t)best * own->multiplier[o] + own->offset[o];
                    value = value > 0 ? value >> own->shift : 0;
                    out[(y * (width / 2) + x) * own->n_out + o] = (dg_activation)(value < 127 ? value : 127);
                }
#else
                best = best * own->scale[o] + own->bias[o];
                out[(y * (width / 2) + x) * own->n_out + o] = best > 0.0f ? best : 0.0f;
#endif
            }
}

/* Add the log-probabilities of one picture, from column `start`, mirrored in velocity or not. */
static void add_picture(const dg_network *own, const float *levels, int start, int mirrored, float *total)
{
    int v, t, n, k, i, height = DG_VELOCITIES, width = DG_TIMES;
    dg_activation *in = layer_even, *out = layer_odd, *other;
    dg_sum sums[DG_MOST_CHANNELS] = {0};
    float scores[DG_CLASSES];
    for (v = 0; v < DG_VELOCITIES; v++)
        for (t = 0; t < DG_TIMES; t++) {
            float level = levels[(start + t) * DG_VELOCITIES + (mirrored ? DG_VELOCITIES - 1 - v : v)];
#if DG_INT8
            in[v * DG_TIMES + t] = (dg_activation)(level * 127.0f + 0.5f);
#else
            in[v * DG_TIMES + t] = level;
#endif
        }
    for (n = 0; n < DG_LAYERS; n++) {
        layer_answer(&own->layers[n], in, height, width, out);
        height /= 2;
        width /= 2;
        other = in;
        in = out;
        out = other;
    }
    n = own->layers[DG_LAYERS - 1].n_out;
    for (i = 0; i < height * width; i++)
        for (k = 0; k < n; k++)
            sums[k] += in[i * n + k];
    for (k = 0; k < DG_CLASSES; k++) {
        dg_sum sum = 0;
        for (i = 0; i < n; i++)
            sum += sums[i] * own->weight[k * n + i];
        scores[k] = (float)sum * own->scale[k] + own->bias[k];
    }
    log_softmax(scores);
    for (k = 0; k < DG_CLASSES; k++)
        total[k] += scores[k];
}

void dg_decide_levels(const float *levels, dg_decision *decision)
{
    float total[DG_CLASSES] = {0.0f}, answer[DG_CLASSES];
    int n, k, p;
    for (n = 0; n < DG_NETWORKS; n++) {
        fill_zero(answer, DG_CLASSES);
        for (p = 0; p < DG_PICTURES; p++) {
            add_picture(&networks[n], levels, picture_starts[p], 0, answer);
            add_picture(&networks[n], levels, picture_starts[p], 1, answer);
        }
        for (k = 0; k < DG_CLASSES; k++)
            answer[k] /= 2.0f * DG_PICTURES;
        log_softmax(answer);
        add_calibrated(answer, networks[n].slope, networks[n].shift, networks[n].share, total);
    }
    log_softmax(total);
    fill_zero(answer, DG_CLASSES);
    add_calibrated(total, calibration_slope, calibration_shift, 1.0f, answer);
    decision->label = 0;
    for (k = 0; k < DG_CLASSES; k++) {
        decision->probability[k] = expf(answer[k]);
        if (decision->probability[k] > decision->probability[decision->label])
            decision->label = k;
    }
    decision->decided = decision->probability[decision->label] >= DG_ABSTAIN_BELOW;
}

/* Fourier transform of spectrum[0] by Stockham's algorithm; returns where it is. */
static float (*transform(void))[2]
{
    int stage, n = DG_DOPPLER, stride = 1, which = 0;
    for (stage = 0; stage < DG_STAGES; stage++) {
        float(*in)[2] = spectrum[which], (*out)[2] = spectrum[1 - which];
        int p = factors[stage], m = n / p, j, q, r, t;
        if (p == 2) /* the same, with half of the work */
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
        for (j = p == 2 ? m : 0; j < m; j++)
            for (q = 0; q < stride; q++)
                for (r = 0; r < p; r++) {
                    float re = 0.0f, im = 0.0f;
                    for (t = 0; t < p; t++) {
                        int32_t turn = ((int32_t)r * t * (DG_DOPPLER / p) + (int32_t)j * r * stride) % DG_DOPPLER;
                        const float *z = in[q + stride * (j + t * m)];
                        re += z[0] * turns[turn][0] + z[1] * turns[turn][1];
                        im += z[1] * turns[turn][0] - z[0] * turns[turn][1];
                    }
                    out[q + stride * (p * j + r)][0] = re;
                    out[q + stride * (p * j + r)][1] = im;
                }
        n = m;
        stride *= p;
        which = 1 - which;
    }
    return spectrum[which];
}

static void clear(dg_window *window)
{
    fill_zero(window->rows, DG_DOPPLER);
    fill_zero(&window->cells[0][0], DG_COLUMNS * DG_VELOCITIES);
    window->column = 0;
}

void dg_start(dg_window *window)
{
    int b;
    clear(window);
    for (b = 0; b < DG_BINS; b++) {
        window->weight[b] = 1.0f;
        fill_zero(window->still[b], 2);
        fill_zero(window->rest[b], 2);
    }
    window->pulses = 0;
    window->place = 0;
    window->wait = DG_CPI;
}

/* One column of the short-time transform: power summed over the gate, then over rows and columns of the picture. */
static void add_column(dg_window *window)
{
    float power[DG_DOPPLER];
    int b, m, k, v, c;
    for (k = 0; k < DG_DOPPLER; k++)
        power[k] = 0.0f;
    for (b = 0; b < DG_BINS; b++) {
        float(*found)[2];
        if (!(window->weight[b] > 0.0f))
            continue;
        fill_zero(&spectrum[0][0][0], 2 * DG_DOPPLER);
        for (m = 0; m < DG_CPI; m++) {
            const float *pulse = window->ring[b][(window->place + m) % DG_CPI];
            spectrum[0][m][0] = taper[m] * pulse[0];
            spectrum[0][m][1] = taper[m] * pulse[1];
        }
        found = transform();
        for (k = 0; k < DG_DOPPLER; k++) { /* rows rise from the most negative Doppler frequency */
            const float *z = found[(k - DG_DOPPLER / 2 + DG_DOPPLER) % DG_DOPPLER];
            power[k] += window->weight[b] * (z[0] * z[0] + z[1] * z[1]);
        }
    }
    for (k = 0; k < DG_DOPPLER; k++)
        window->rows[k] += power[k];
    c = (int)(window->column / DG_COLUMNS_PER_CELL);
    for (; c < DG_COLUMNS && c * DG_COLUMNS_PER_CELL < window->column + 1; c++) {
        float low = (float)(c * DG_COLUMNS_PER_CELL - window->column);
        float high = (float)((c + 1) * DG_COLUMNS_PER_CELL - window->column), share;
        low = low > 0.0f ? low : 0.0f;
        high = high < 1.0f ? high : 1.0f;
        share = high > low ? (high - low) / (float)DG_COLUMNS_PER_CELL : 0.0f; /* of this column in the cell */
        for (v = 0; v < DG_VELOCITIES; v++) {
            int from = edge_rows[v], to = edge_rows[v + 1];
            float width = (float)(to - from) + (edge_parts[v + 1] - edge_parts[v]), sum;
            if (!(width > 1e-6f)) /* the radar sees no such velocity */
                continue;
            sum = from == to ? width * power[from] : (1.0f - edge_parts[v]) * power[from];
            for (k = from + 1; k < to; k++)
                sum += power[k];
            if (to > from && to < DG_DOPPLER)
                sum += edge_parts[v + 1] * power[to];
            window->cells[c][v] += share * sum / width;
        }
    }
    window->column++;
}

int dg_push(dg_window *window, const float *samples)
{
    int b, part;
    if (window->column >= DG_STFT_COLUMNS) /* nobody asked for the decision */
        clear(window);
    for (b = 0; b < DG_BINS; b++)
        for (part = 0; part < 2; part++) {
            float value = samples[2 * b + part];
            if (!isfinite(value)) { /* or every later window would be lost with it */
                window->ring[b][window->place][part] = 0.0f;
                continue;
            }
#if DG_REMOVE_STILL
            float share = 1.0f / (float)(window->pulses + 1u), step, mean;
            share = share > DG_STILL_SHARE ? share : DG_STILL_SHARE;
            if (window->pulses == 0)
                window->first[b][part] = value;
            value -= window->first[b][part];
            step = share * (value - window->still[b][part]) - window->rest[b][part];
            mean = window->still[b][part] + step;
            window->rest[b][part] = (mean - window->still[b][part]) - step;
            window->still[b][part] = mean;
            value -= mean;
#endif
            window->ring[b][window->place][part] = value;
        }
    if (window->pulses < 0xfffffffeu)
        window->pulses++;
    window->place = (window->place + 1) % DG_CPI;
    if (--window->wait > 0)
        return 0;
    window->wait = DG_HOP;
    add_column(window);
    return window->column == DG_STFT_COLUMNS;
}

static void sort(float *values, int n)
{
    int i, j;
    for (i = 1; i < n; i++) {
        float value = values[i];
        for (j = i; j > 0 && values[j - 1] > value; j--)
            values[j] = values[j - 1];
        values[j] = value;
    }
}

/* Replace power by levels, 0 to 1; return the strongest cell over the noise floor, or 0 without a signal. */
static float power_to_levels(dg_window *window)
{
    int k, c, v, n = 0, quiet;
    float floor_power = 0.0f, peak, lowest;
    for (k = 0; k < DG_DOPPLER; k++)
        if (window->rows[k] > 0.0f)
            sorted[n++] = window->rows[k] / DG_STFT_COLUMNS;
    sort(sorted, n);
    quiet = n / 3 > 0 ? n / 3 : 1;
    for (k = 0; k < quiet && n > 0; k++)
        floor_power += sorted[k] / (float)quiet;
    for (c = 0; c < DG_COLUMNS; c++) {
        sorted[c] = window->cells[c][0];
        for (v = 1; v < DG_VELOCITIES; v++)
            if (window->cells[c][v] > sorted[c])
                sorted[c] = window->cells[c][v];
    }
    sort(sorted, DG_COLUMNS);
    peak = 0.5f * (sorted[(DG_COLUMNS - 1) / 2] + sorted[DG_COLUMNS / 2]);
    lowest = peak * DG_LOWEST_SHARE;
    if (floor_power > lowest)
        lowest = floor_power;
    for (c = 0; c < DG_COLUMNS; c++)
        for (v = 0; v < DG_VELOCITIES; v++) {
            float level = 0.0f;
            if (lowest > 0.0f && window->cells[c][v] > lowest)
                level = 10.0f * log10f(window->cells[c][v] / lowest) / DG_RANGE_DB;
            window->cells[c][v] = level < 1.0f ? level : 1.0f;
        }
    return floor_power > 0.0f ? peak / floor_power : 0.0f;
}

void dg_decide(dg_window *window, dg_decision *decision)
{
    float ratio = power_to_levels(window);
    dg_decide_levels(&window->cells[0][0], decision);
    decision->peak_over_floor_db = ratio > 0.0f ? 10.0f * log10f(ratio) : 0.0f;
    if (!(ratio > 0.0f))
        decision->decided = 0;
    clear(window);
}
