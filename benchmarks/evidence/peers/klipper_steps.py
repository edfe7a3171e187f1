"""Our step queues through Klipper's own firmware: `python -m benchmarks.evidence.peers.klipper_steps [KLIPPER]`.

KLIPPER is a checkout of Klipper (default ~/klipper, where its installer puts it); its `src/stepper.c`, which makes the
steps on a board, is compiled for this computer with a clock that stands in for the board's. Each plan's export `steps`
is fed to its commands queue_step, set_next_step_dir and reset_step_clock, and every rise of a step pin is compared with
the plan's pulse: its tick, its direction. Skipped by name where there is no checkout or no C compiler (cc).
"""

import shutil
import subprocess
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from planner import load_program, plan

PROGRAMS = "bare-circle,circle,arm-square,tripod-circle,traverser-scan,linkage-line"
CLOCK_HZ = 16_000_000
PULSE_TICKS = 2
"""Klipper's usual 100 ns that STEP is high with Trinamic drives, of CLOCK_HZ; with others it is 2 us."""
SHIM = {
    "autoconf.h": "#define CONFIG_CLOCK_FREQ 16000000\n#define CONFIG_INLINE_STEPPER_HACK 0\n",
    "board/gpio.h": """#include <stdint.h>
struct gpio_out { int oid, dir; };
struct gpio_out gpio_out_setup(uint32_t pin, uint32_t val);
void gpio_out_toggle_noirq(struct gpio_out g);
void gpio_out_write(struct gpio_out g, uint32_t val);
""",
    "board/irq.h": "static inline void irq_disable(void) {}\nstatic inline void irq_enable(void) {}\n",
    "board/misc.h": """#include <stdint.h>
uint32_t timer_read_time(void);
static inline uint32_t timer_from_us(uint32_t us) { return us * 16; }
static inline uint8_t timer_is_before(uint32_t a, uint32_t b) { return (int32_t)(a - b) < 0; }
""",
    "board.c": """#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "autoconf.h"
#include "board/gpio.h"
#include "basecmd.h"
#include "command.h"
#include "sched.h"
#include "trsync.h"
void command_config_stepper(uint32_t *), command_queue_step(uint32_t *), command_set_next_step_dir(uint32_t *);
void command_reset_step_clock(uint32_t *);
enum { AXES = 64, MOVES = 1024 };
static uint64_t now;
static struct timer *timers[AXES];
static void *objects[AXES];
static int level[2][AXES], queued, size;
static char text[256];
uint32_t timer_read_time(void) { return now; }
struct gpio_out gpio_out_setup(uint32_t pin, uint32_t val) { return (struct gpio_out){pin / 2, pin % 2}; }
void gpio_out_write(struct gpio_out g, uint32_t val) { level[g.dir][g.oid] = val; }
void gpio_out_toggle_noirq(struct gpio_out g) {
    level[g.dir][g.oid] ^= 1;
    if (!g.dir && level[0][g.oid]) printf("%d %llu %d\\n", g.oid, (unsigned long long)now, level[1][g.oid]);
}
void sched_add_timer(struct timer *t) {
    for (int k = 0; k < AXES; k++) if (!timers[k]) { timers[k] = t; return; }
}
void sched_del_timer(struct timer *t) { for (int k = 0; k < AXES; k++) if (timers[k] == t) timers[k] = 0; }
void sched_shutdown(uint_fast8_t reason) { fprintf(stderr, "shutdown: %s\\n", text); exit(1); }
uint8_t ctr_lookup_static_string(const char *str) { snprintf(text, sizeof text, "%s", str); return 0; }
const struct command_encoder *ctr_lookup_encoder(const char *str) { return 0; }
void command_sendf(const struct command_encoder *ce, ...) {}
struct trsync *trsync_oid_lookup(uint8_t oid) { return 0; }
void trsync_add_signal(struct trsync *t, struct trsync_signal *s, trsync_callback_t f) {}
void *oid_alloc(uint8_t oid, void *type, uint16_t bytes) { return objects[oid] = calloc(1, bytes); }
void *oid_lookup(uint8_t oid, void *type) { return objects[oid]; }
void *oid_next(uint8_t *i, void *type) { return 0; }
void move_queue_setup(struct move_queue_head *mh, int bytes) { size = bytes; mh->first = mh->last = 0; }
void *move_alloc(void) { queued++; return calloc(1, size); }
void move_free(void *m) { queued--; free(m); }
int move_queue_empty(struct move_queue_head *mh) { return !mh->first; }
int move_queue_push(struct move_node *m, struct move_queue_head *mh) {
    m->next = 0;
    if (mh->first) mh->last->next = m; else mh->first = m;
    mh->last = m;
    return 0;
}
struct move_node *move_queue_pop(struct move_queue_head *mh) {
    struct move_node *m = mh->first;
    mh->first = m->next;
    return m;
}
void move_queue_clear(struct move_queue_head *mh) { mh->first = 0; }
/* the next timer of the board; 0: there is none */
static int dispatch(void) {
    int first = -1;
    for (int k = 0; k < AXES; k++)
        if (timers[k] && (first < 0 || (int32_t)(timers[k]->waketime - timers[first]->waketime) < 0)) first = k;
    if (first < 0) return 0;
    int32_t wait = timers[first]->waketime - (uint32_t)now;
    if (wait < 0) { fprintf(stderr, "shutdown: timer in the past by %d ticks\\n", -wait); exit(1); }
    now += wait;
    struct timer *t = timers[first];
    if (t->func(t) == SF_DONE) timers[first] = 0;
    return 1;
}
static int is_active(struct timer *t) {
    for (int k = 0; k < AXES; k++) if (timers[k] == t) return 1;
    return 0;
}
int main(int count, char **words) {
    int axes = atoi(words[1]), pulse = atoi(words[2]);
    char line[256], name[32];
    for (int k = 0; k < axes; k++) command_config_stepper((uint32_t[]){k, 2 * k, 2 * k + 1, 0, pulse});
    while (fgets(line, sizeof line, stdin)) {
        long long a[4] = {0};
        if (sscanf(line, "%31s %lld %lld %lld %lld", name, a, a + 1, a + 2, a + 3) < 3 || *name == '#') continue;
        uint32_t args[4] = {a[0], a[1], a[2], a[3]};
        while (queued >= MOVES && dispatch());
        if (!strcmp(name, "queue_step")) command_queue_step(args);
        else if (!strcmp(name, "set_next_step_dir")) command_set_next_step_dir(args);
        else if (!strcmp(name, "reset_step_clock")) {
            while (is_active(objects[a[0]]) && dispatch());
            command_reset_step_clock(args);
        }
    }
    while (dispatch());
}
""",
}
"""What the board is to the firmware: pins, a clock that goes from timer to timer, and memory for moves."""


def build_firmware(klipper: Path, folder: Path) -> Path:
    """Compile Klipper's stepper.c with the shim around it."""
    for name, text in SHIM.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    program = folder / "steps"
    sources = [str(klipper / "src" / "stepper.c"), str(folder / "board.c")]
    include = [f"-I{folder}", f"-I{klipper / 'src'}"]
    subprocess.run(["cc", "-std=gnu11", "-O2", "-w", *include, "-o", str(program), *sources], check=True)
    return program


def step(program: Path, file: Path, axes: int, pulse_ticks: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ticks and levels of DIR at every rise of STEP, of each axis."""
    with file.open() as commands:
        done = subprocess.run(
            [program, str(axes), str(pulse_ticks)], stdin=commands, capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise RuntimeError(f"{file.name}: Klipper's firmware ended with {done.stderr.strip()}")
    found = np.array([line.split() for line in done.stdout.splitlines()], np.int64).reshape(-1, 3)
    return [(mine[:, 1], mine[:, 2]) for mine in (found[found[:, 0] == k] for k in range(axes))]


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("klipper", nargs="?", type=Path, default=Path.home() / "klipper")
    parser.add_argument("--programs", default=PROGRAMS)
    parser.add_argument("--pulse-ticks", type=int, default=PULSE_TICKS)
    asked = parser.parse_args()
    if not (asked.klipper / "src" / "stepper.c").is_file():
        print(f"there is no checkout of Klipper in {asked.klipper} (github.com/Klipper3d/klipper): skipped")
        return
    if shutil.which("cc") is None:
        print("there is no C compiler (cc): skipped")
        return
    rows = []
    with TemporaryDirectory() as place:
        folder = Path(place)
        firmware = build_firmware(asked.klipper, folder)
        for name in asked.programs.split(","):
            program = load_program(name)
            assert program.machine is not None
            made = plan(program, load_machine(program.machine), clock_hz=CLOCK_HZ)
            for within in (0.0, 1e-6):
                file = folder / "plan.steps"
                made.export("steps", file, within=within, force=True)
                commands = sum(line.startswith("queue_step") for line in file.open())
                late, wrong, pulses = 0, 0, 0
                for (ticks, level), own, axis in zip(
                    step(firmware, file, len(made.pulses.axes), asked.pulse_ticks),
                    made.pulses.axes,
                    made.machine.axes,
                    strict=True,
                ):
                    pulses += len(own)
                    same = min(len(ticks), len(own))
                    wrong += abs(len(ticks) - len(own))
                    wrong += int(((2 * level - 1)[:same] * axis.direction != own.direction[:same]).sum())
                    late = max(late, int(abs(ticks[:same] - own.ticks[:same]).max(initial=0)))
                told = (f"{1e6 * within:g} us", pulses, commands, wrong, f"{1e6 * late / CLOCK_HZ:.3g} us")
                rows.append([name, *map(str, told)])
    print(markdown(("program", "within", "pulses", "commands", "missing or of wrong direction", "most off"), rows))


if __name__ == "__main__":
    main()
