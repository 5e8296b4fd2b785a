/// @file fuzz_trajectory.c  libFuzzer target: the trajectory CSV reader.
///
/// Oracle: refused with a message, or times ascend, all numbers are finite, and the pose at any
/// time is a finite one with a unit quaternion.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "haptic/device/trajectory.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    pal_trajectory t;
    pal_error error = {0};
    if (pal_trajectory_parse("fuzzed", (const char *)data, size, &t, &error) != PALPATE_OK) {
        if (error.message[0] == 0) {
            abort();
        }
        return 0;
    }
    for (int64_t i = 1; i < t.count; i++) {
        if (!(t.sample[i].time > t.sample[i - 1].time)) {
            abort();
        }
    }
    const double at[] = {0.0, 0.5, 1e9, t.count > 0 ? t.sample[t.count - 1].time : 0.0};
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        pal_tool_state s = {{0.0}, {0.0}, 0, 0, 0};
        pal_trajectory_at(&t, at[i], &s);
        double norm = 0.0;
        for (int k = 0; k < 4; k++) {
            norm += s.orientation[k] * s.orientation[k];
        }
        // 1e-6: far above what normalising and interpolating round
        if (!isfinite(s.position[0] + s.position[1] + s.position[2]) ||
            !(fabs(norm - 1.0) < 1e-6)) {
            abort();
        }
    }
    pal_trajectory_clear(&t);
    return 0;
}
