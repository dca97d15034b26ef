/* Compare the exported model with the golden vectors: pictures of a track, and the probabilities that doppelgait gives.

   cc -std=c99 -O2 selftest.c doppelgait_model.c -lm -o selftest && ./selftest golden.bin

   The file holds two int32 numbers: 3, and how many pictures follow; then for each the time since the one before (below
   0: of another track), its levels and the expected probabilities, float32, as this machine stores them. */
#include "doppelgait_model.h"

#include <math.h>
#include <stdio.h>

static float picture[DG_TIMES * DG_VELOCITIES * DG_SLICES], expected[DG_CLASSES], since_s;
static dg_decision decision;

int main(int count, char **words)
{
    static const dg_memory nothing;
    dg_memory memory = nothing;
    int32_t head[2] = {0, 0}, i, k;
    float worst = 0.0f;
    FILE *file = count > 1 ? fopen(words[1], "rb") : 0;
    if (!file || fread(head, sizeof(int32_t), 2, file) != 2 || head[0] != 3) {
        fprintf(stderr, "usage: selftest golden.bin\n");
        return 2;
    }
    for (i = 0; i < head[1]; i++) {
        if (fread(&since_s, sizeof since_s, 1, file) != 1 || fread(picture, sizeof picture, 1, file) != 1 ||
            fread(expected, sizeof expected, 1, file) != 1)
            return 3;
        if (since_s < 0.0f)
            memory = nothing;
        dg_follow(&memory, picture, since_s < 0.0f ? 0.0f : since_s, &decision);
        for (k = 0; k < DG_CLASSES; k++) {
            float apart = fabsf(decision.probability[k] - expected[k]);
            if (!(apart <= worst))
                worst = isnan(apart) ? 1.0f : apart;
        }
    }
    fclose(file);
    printf("%d pictures, probabilities differ by at most %.2g; %d bytes of a radar\n", (int)head[1], (double)worst,
           (int)sizeof(dg_radar));
    return worst > DG_TOLERANCE;
}
