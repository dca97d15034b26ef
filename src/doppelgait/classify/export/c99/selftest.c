/* Compare the exported model with the golden vectors: inputs and the probabilities that doppelgait gives.

   cc -std=c99 -O2 selftest.c doppelgait_model.c -lm -o selftest && ./selftest golden.bin [probabilities.bin]

   The file holds three int32 numbers: 2, and how many examples of samples and of levels follow; then for each its inputs
   and expected probabilities, float32, as this machine stores them. */
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
        dg_decide_levels(levels, &decision);
        apart = difference(decision.probability);
        worst = apart > worst ? apart : worst;
    }
    return report("levels", n, worst, 1e-4f);
}

int main(int count, char **words)
{
    int32_t head[3] = {0, 0, 0};
    int failed = 0;
    FILE *file = count > 1 ? fopen(words[1], "rb") : 0;
    if (!file || fread(head, sizeof(int32_t), 3, file) != 3 || head[0] != 2) {
        fprintf(stderr, "usage: selftest golden.bin [probabilities.bin]\n");
        return 2;
    }
    answers = count > 2 ? fopen(words[2], "wb") : 0;
    failed |= head[1] ? test_samples(file, (int)head[1]) : 0;
    failed |= head[2] ? test_levels(file, (int)head[2]) : 0;
    printf("RAM: %lu bytes of window, %lu bytes of buffers\n", (unsigned long)sizeof(dg_window),
           (unsigned long)DG_BUFFER_BYTES);
    fclose(file);
    if (answers)
        fclose(answers);
    return failed;
}
