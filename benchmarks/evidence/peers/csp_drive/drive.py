"""An emulated drive of CiA 402 in mode 8, cyclic synchronous position: one axis.

Written from what the standard (IEC 61800-7-201) states in public: an object dictionary, the state machine of
controlword and statusword, straight lines or parabolas between rows at the drive's own cycle, and a position loop
around a speed loop around an inertia. Where makers differ: beyond 0x607D the demand stays at the limit, while rows
faster than 0x6080 (here increments/s) or 0x60C5 are followed; both set bit 11. The velocity offset goes evenly from row
to row. A fault and a quick stop brake by the speed loop; a brake holds the motor wherever it is off.
"""

from enum import IntEnum

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel

TICK = 62.5e-6
"""s, of the drive's loops."""
POSITION_GAIN, SPEED_GAIN, INTEGRAL_TIME = 60.0, 500.0, 10e-3
"""1/s of the position loop, 1/s of the speed loop (80 Hz), s of its integral. ASSUMPTION: a usual servo axis'."""
STANDING = 1.0
"""increments/s below which braking ends."""

INTEGERS = {f"{sign}{bits}": (sign == "i", bits) for sign in "iu" for bits in (8, 16, 32)}
OBJECTS = {
    (0x603F, 0): ("error code", "u16", "ro", 0),
    (0x6040, 0): ("controlword", "u16", "rw", 0),
    (0x6041, 0): ("statusword", "u16", "ro", 0),
    (0x6060, 0): ("modes of operation", "i8", "rw", 0),
    (0x6061, 0): ("modes of operation display", "i8", "ro", 0),
    (0x6062, 0): ("position demand value", "i32", "ro", 0),
    (0x6064, 0): ("position actual value", "i32", "ro", 0),
    (0x6065, 0): ("following error window", "u32", "rw", 0xFFFFFFFF),
    (0x6066, 0): ("following error time out", "u16", "rw", 0),
    (0x607A, 0): ("target position", "i32", "rw", 0),
    (0x607D, 1): ("min position limit", "i32", "rw", -(1 << 31)),
    (0x607D, 2): ("max position limit", "i32", "rw", (1 << 31) - 1),
    (0x6080, 0): ("max motor speed", "u32", "rw", 0xFFFFFFFF),
    (0x60B1, 0): ("velocity offset", "i32", "rw", 0),
    (0x60B2, 0): ("torque offset", "i16", "rw", 0),
    (0x60C2, 1): ("interpolation time period value", "u8", "rw", 1),
    (0x60C2, 2): ("interpolation time index", "i8", "rw", -3),
    (0x60C5, 0): ("max acceleration", "u32", "rw", 0xFFFFFFFF),
    (0x6502, 0): ("supported drive modes", "u32", "ro", 1 << 7),
}
"""Name, type, access and value by index and subindex."""
MODE = 8
NO_WINDOW = 0xFFFFFFFF
FOLLOWING_ERROR = 0x8611
NO_OBJECT, NO_SUBINDEX, READ_ONLY, OUT_OF_RANGE = 0x06020000, 0x06090011, 0x06010002, 0x06090030
"""Abort codes of an access."""


class DriveState(IntEnum):
    """A state, as the bits 0 to 3, 5 and 6 of the statusword state it."""

    DISABLED, READY, ON, ENABLED, STOPPING, REACTING, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08


COMMANDS = (
    (
        0x82,
        0x00,
        dict.fromkeys((DriveState.READY, DriveState.ON, DriveState.ENABLED, DriveState.STOPPING), DriveState.DISABLED),
    ),
    (
        0x86,
        0x02,
        {
            DriveState.READY: DriveState.DISABLED,
            DriveState.ON: DriveState.DISABLED,
            DriveState.ENABLED: DriveState.STOPPING,
        },
    ),
    (0x87, 0x06, dict.fromkeys((DriveState.DISABLED, DriveState.ON, DriveState.ENABLED), DriveState.READY)),
    (0x8F, 0x07, dict.fromkeys((DriveState.READY, DriveState.ENABLED), DriveState.ON)),
    (0x8F, 0x0F, dict.fromkeys((DriveState.READY, DriveState.ON, DriveState.STOPPING), DriveState.ENABLED)),
)
"""Mask and bits of a controlword, and where it leads: disable voltage, quick stop, shutdown, switch on, enable."""
RESET = 0x80
VOLTAGE, REMOTE, LIMITED, FOLLOWS, BEYOND = 0x10, 0x200, 0x800, 0x1000, 0x2000
"""Bits 4, 9, 11, 12 and 13 of the statusword."""


class SdoError(Exception):
    """An access that the drive refuses; `code` is CiA 301's."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


@kernel
def run_loops(
    motion: Array, demand: Array, way: Array, offset: Array, load: Array, period: float, window: float, brakes: bool
) -> float:
    """The drive's cycles until the next row: the longest time (s) that the following error has been beyond its window.

    motion  position, speed, integral, acceleration that the motor gives from its next cycle on, s beyond the window,
            largest following error so far; increments and s
    demand  (N,) filled in with the position demand of each cycle
    way     where the way begins, the chord to the row, and the second difference of the last three rows, 0 for a line
    offset  of velocity, at the beginning and the end of the period; acceleration by the torque offset, likewise
    load    acceleration by the load, before and after these cycles
    period  cycles of the drive that the way takes
    """
    longest = 0.0
    for j in range(len(demand)):
        u = min(j / period, 1.0)
        demand[j] = way[0] + u * way[1] - u * (1 - u) / 2 * way[2]
        error = demand[j] - motion[0]
        motion[4] = motion[4] + TICK if abs(error) > window else 0.0
        motion[5] = max(motion[5], abs(error))
        longest = max(longest, motion[4])
        speed = 0.0 if brakes else POSITION_GAIN * error + offset[0] + u * (offset[1] - offset[0])
        push = motion[3] + load[0] + j / len(demand) * (load[1] - load[0])
        motion[2] += SPEED_GAIN / INTEGRAL_TIME * (speed - motion[1]) * TICK
        motion[3] = SPEED_GAIN * (speed - motion[1]) + motion[2] + offset[2] + u * (offset[3] - offset[2])
        motion[0] += TICK * (motion[1] + push * TICK / 2)
        motion[1] += push * TICK
    return longest


class Drive:
    """One axis.

    at        increments where the motor stands
    rated     increments/s² that the rated torque gives the motor
    parabola  the way from row to row: along the parabola of a row and the two before it, or straight
    """

    def __init__(self, at: float = 0.0, *, rated: float = 0.0, parabola: bool = False) -> None:
        self.state = DriveState.DISABLED
        self.rated, self.parabola = rated, parabola
        self.bits, self.error, self.demand = 0, 0, at
        self.rows = (at, at)  # the last two that were demanded
        self.motion = np.array([at, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.offset = np.zeros(4)
        self.values = {key: entry[3] for key, entry in OBJECTS.items()}

    def read(self, index: int, subindex: int = 0) -> int:
        self._find(index, subindex)
        if index == 0x6041:
            return self.state | VOLTAGE | REMOTE | self.bits
        if index in (0x6062, 0x6064):
            return round(self.demand if index == 0x6062 else float(self.motion[0]))
        if index in (0x603F, 0x6061):
            return self.error if index == 0x603F else self.values[0x6060, 0]
        return self.values[index, subindex]

    def write(self, index: int, value: int, subindex: int = 0) -> None:
        """Set an object. Raises SdoError."""
        _, kind, access, _ = self._find(index, subindex)
        signed, bits = INTEGERS[kind]
        if access == "ro":
            raise SdoError(READ_ONLY)
        inside = 0 <= value + (1 << (bits - 1) if signed else 0) < 1 << bits
        if not inside or (index == 0x6060 and value not in (0, MODE)):
            raise SdoError(OUT_OF_RANGE)
        before, self.values[index, subindex] = self.values[index, subindex], value
        if index == 0x6040:
            self._command(value, before)

    def _find(self, index: int, subindex: int) -> tuple[str, str, str, int]:
        if (index, subindex) not in OBJECTS:
            raise SdoError(NO_SUBINDEX if any(index == known for known, _ in OBJECTS) else NO_OBJECT)
        return OBJECTS[index, subindex]

    def _command(self, word: int, before: int) -> None:
        if self.state == DriveState.FAULT and word & RESET and not before & RESET:
            self.state, self.error, self.bits = DriveState.DISABLED, 0, 0
            return
        for mask, bits, leads in COMMANDS:
            if word & mask == bits and self.state in leads:
                if self.state < DriveState.ENABLED and leads[self.state] == DriveState.ENABLED:
                    self.demand = round(float(self.motion[0]))  # it begins where the motor stands
                    self.rows = (self.demand, self.demand)
                self.state = leads[self.state]
                return

    def run(self, ticks: int, load: tuple[float, float] = (0.0, 0.0)) -> Array:
        """So many of its cycles after a row came: the position demand (ticks,) of each, unrounded."""
        demand = np.empty(ticks)
        period = self.values[0x60C2, 1] * 10.0 ** self.values[0x60C2, 2]
        way, offset = np.array([self.demand, 0.0, 0.0]), np.array([self.offset[1], 0.0, self.offset[3], 0.0])
        if self.state == DriveState.ENABLED:
            row = self._take_row(period)
            twice = row - 2 * self.rows[1] + self.rows[0]
            way[1:] = row - self.demand, twice if self.parabola else 0.0
            offset[1] = self.values[0x60B1, 0] if self.bits & FOLLOWS else 0
            offset[3] = self.values[0x60B2, 0] / 1000 * self.rated
            self.rows = (self.rows[1], row)
        elif self.state not in (DriveState.STOPPING, DriveState.REACTING):
            self.motion[1:5] = 0.0
            self.offset[:] = 0.0
            self.demand = float(self.motion[0])
            demand[:] = self.demand
            return demand
        brakes = self.state != DriveState.ENABLED
        window = np.inf if self.values[0x6065, 0] == NO_WINDOW or brakes else float(self.values[0x6065, 0])
        arguments = way, offset, np.array(load), period / TICK, window, brakes
        beyond = run_loops(self.motion, demand, *arguments)
        self.offset[:] = offset
        u = min(ticks * TICK / period, 1.0)
        self.demand = float(way[0] + u * way[1] - u * (1 - u) / 2 * way[2])
        if beyond > 1e-3 * self.values[0x6066, 0]:
            self.state, self.error, self.bits = DriveState.REACTING, FOLLOWING_ERROR, self.bits & LIMITED | BEYOND
        elif brakes and abs(self.motion[1]) < STANDING:
            self.state = DriveState.FAULT if self.state == DriveState.REACTING else DriveState.DISABLED
        return demand

    def _take_row(self, period: float) -> int:
        """The target within the position limits, in another mode the last one; what is beyond a limit sets bit 11."""
        if self.values[0x6060, 0] != MODE:
            self.bits = 0
            return round(self.rows[1])
        target = self.values[0x607A, 0]
        row = min(max(target, self.values[0x607D, 1]), self.values[0x607D, 2])
        step, last = row - self.rows[1], self.rows[1] - self.rows[0]
        fast = abs(step) > self.values[0x6080, 0] * period or abs(step - last) > self.values[0x60C5, 0] * period**2
        self.bits = (LIMITED if fast or row != target else 0) | (FOLLOWS if row == target else 0)
        return row
