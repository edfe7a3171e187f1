/* Decode a queue of steps, as `pulsepath export DIR --format steps` writes it, the way a micro-controller runs it.

     cc -O2 -o steps_decoder steps_decoder.c && ./steps_decoder < steps.steps
   For each pulse a line "oid tick direction". Whole numbers only: 64 bits of clock, 32 of interval, as in firmware. Pulse
   k of a command falls at last + (k+1) interval + add k(k+1)/2; last is the axis' last pulse (a comment says it of a
   motion that goes on with another), or the clock of its reset. Exit code 1, with the line, for what is no queue. */

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#define AXES 32

struct axis {
    int64_t last;
    int direction; /* +1, -1; 0 until it is set */
    int set;       /* its clock is known */
};

static int refuse(int line, const char *why) {
    fprintf(stderr, "line %d: %s\n", line, why);
    return 1;
}

int main(void) {
    static struct axis axes[AXES];
    char text[256];
    for (int line = 1; fgets(text, sizeof text, stdin); line++) {
        unsigned oid, direction, count;
        int64_t clock;
        uint32_t interval;
        int32_t add;
        char more;
        if (sscanf(text, "# oid %u goes on, its last pulse at %" SCNd64, &oid, &clock) == 2 && oid < AXES)
            axes[oid] = (struct axis){clock, 0, 1};
        if (text[0] == '#' || text[0] == '\n')
            continue;
        if (!strchr(text, '\n'))
            return refuse(line, "is too long, or the file ends within it");
        if (sscanf(text, "reset_step_clock %u %" SCNd64 " %c", &oid, &clock, &more) == 2 && oid < AXES) {
            if (axes[oid].set && clock < axes[oid].last)
                return refuse(line, "the clock goes back");
            axes[oid].last = clock, axes[oid].set = 1;
        } else if (sscanf(text, "set_next_step_dir %u %u %c", &oid, &direction, &more) == 2 && oid < AXES && direction < 2) {
            axes[oid].direction = direction ? 1 : -1;
        } else if (sscanf(text, "queue_step %u %" SCNu32 " %u %" SCNd32 " %c", &oid, &interval, &count, &add, &more) == 4 &&
                   oid < AXES && count >= 1 && count <= 65535 && add >= -32767 && add <= 32767) {
            if (!axes[oid].set || !axes[oid].direction)
                return refuse(line, "steps before the axis has a clock and a direction");
            for (int64_t k = 0, wait = interval; k < count; k++, wait += add) {
                if (wait <= 0)
                    return refuse(line, "steps that do not follow each other");
                axes[oid].last += wait;
                printf("%u %" PRId64 " %d\n", oid, axes[oid].last, axes[oid].direction);
            }
        } else {
            return refuse(line, "is no command of a queue of steps");
        }
    }
    return 0;
}
