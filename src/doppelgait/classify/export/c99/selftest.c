/* Compare the exported model with the golden vectors: inputs and the probabilities that doppelgait gives.

   cc -std=c99 -O2 selftest.c doppelgait_model.c -lm -o selftest && ./selftest golden.bin [probabilities.bin]

   The file holds four int32 numbers: 1, and how many examples of samples, levels and features follow; then for each its
   inputs and expected probabilities, float32, as this machine stores them. */
#include "doppelgait_model.h"

#include <math.h>
#include <stdio.h>

static float expected[DG_CLASSES];
static FILE *answers;

static int read_floats(FILE *file, float *values, size_t n)
{
    return fread(values, sizeof(float), n, file) == n;
}

static float difference(const float *found)
{
    float worst = 0.0f;
    int k;
    for (k = 0; k < DG_CLASSES; k++) {
        float apart = fabsf(found[k] - expected[k]);
        if (!(apart <= worst))
            worst = isnan(apart) ? 1.0f : apart;
    }
    if (answers)
        fwrite(found, sizeof(float), DG_CLASSES, answers);
    return worst;
}

static int report(const char *what, int n, float worst, float allowed)
{
    printf("%s: %d examples, probabilities differ by at most %.2g, allowed is %.2g\n", what, n, (double)worst,
           (double)allowed);
    return worst > allowed;
}

#if DG_NETWORKS
static dg_window window;
static dg_decision decision;
static float pulses[DG_WINDOW_PULSES][2 * DG_BINS], levels[DG_COLUMNS * DG_VELOCITIES];

static int test_samples(FILE *file, int n)
{
    int i, p, complete = 0;
    float worst = 0.0f, apart;
    for (i = 0; i < n; i++) {
        if (!read_floats(file, &pulses[0][0], (size_t)DG_WINDOW_PULSES * 2 * DG_BINS) ||
            !read_floats(file, expected, DG_CLASSES))
            return 2;
        dg_start(&window);
        for (p = 0; p < DG_WINDOW_PULSES; p++)
            complete = dg_push(&window, pulses[p]);
        if (!complete)
            return 3;
        dg_decide(&window, &decision);
        apart = difference(decision.probability);
        worst = apart > worst ? apart : worst;
    }
    return report("samples", n, worst, DG_SAMPLES_TOLERANCE);
}

static int test_levels(FILE *file, int n)
{
    int i;
    float worst = 0.0f, apart;
    for (i = 0; i < n; i++) {
        if (!read_floats(file, levels, DG_COLUMNS * DG_VELOCITIES) || !read_floats(file, expected, DG_CLASSES))
            return 2;
        dg_networks(levels, decision.network);
        dg_decide_networks((const float(*)[DG_CLASSES])decision.network, &decision);
        apart = difference(decision.probability);
        worst = apart > worst ? apart : worst;
    }
    return report("levels", n, worst, 1e-4f);
}
#endif

#if DG_FEATURES
static int test_features(FILE *file, int n)
{
    static float features[DG_FEATURES], networks[DG_NETWORKS + 1][DG_CLASSES], found[DG_CLASSES];
    int i;
    float worst = 0.0f, apart;
    for (i = 0; i < n; i++) {
        if (!read_floats(file, features, DG_FEATURES) ||
            !read_floats(file, &networks[0][0], DG_NETWORKS * DG_CLASSES) || !read_floats(file, expected, DG_CLASSES))
            return 2;
        dg_probability(features, (const float(*)[DG_CLASSES])networks, found);
        apart = difference(found);
        worst = apart > worst ? apart : worst;
    }
    return report("features", n, worst, 1e-4f);
}
#endif

int main(int count, char **words)
{
    int32_t head[4] = {0, 0, 0, 0};
    int failed = 0;
    FILE *file = count > 1 ? fopen(words[1], "rb") : 0;
    if (!file || fread(head, sizeof(int32_t), 4, file) != 4 || head[0] != 1) {
        fprintf(stderr, "usage: selftest golden.bin [probabilities.bin]\n");
        return 2;
    }
    answers = count > 2 ? fopen(words[2], "wb") : 0;
#if DG_NETWORKS
    failed |= head[1] ? test_samples(file, (int)head[1]) : 0;
    failed |= head[2] ? test_levels(file, (int)head[2]) : 0;
    printf("RAM: %lu bytes of window, %lu bytes of buffers\n", (unsigned long)sizeof(dg_window),
           (unsigned long)DG_BUFFER_BYTES);
#endif
#if DG_FEATURES
    failed |= head[3] ? test_features(file, (int)head[3]) : 0;
#endif
    fclose(file);
    if (answers)
        fclose(answers);
    return failed;
}
