"""A commented machine file to start from, made of a bundled one: every key of its kind, with what it means.

What each key of a machine's file means, in the words of the file to start from (`kinematics.machine.machine_starter`).
"""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.files.toml_writer import Key, format_millimetres, table_lines
from kinematics.foundation.arrays import Array
from kinematics.foundation.names import find, source_folder
from kinematics.kinds.hexapod import Hexapod
from kinematics.machine.machine_file import load_machine, toml_of

_HOME = Key("home", 'the pose from which travel and pulses count, in the base frame; turned: rotate = ["0 deg", …]')

HEAD = (
    Key("schema", "of this file"),
    Key("kind", '"hexapod", "tripod", "linkage", "traverser" or "arm"'),
    Key(
        "gravity",
        "in the base frame; this one where nothing is said",
        '["0 m/s^2", "0 m/s^2", "-9.80665 m/s^2"]',
    ),
)

_LEGGED_KEYS = (
    _HOME,
    Key("base_rest", "axis of the base's joints at rest, in its frame; or one for each", "[0, 0, 1]"),
    Key("platform_rest", "the same of the platform's joints, in the platform's frame", "[0, 0, 1]"),
    Key("max_tilt", "of a joint from its axis at rest; two: of the base, of the platform", '"35 deg"'),
    Key("leg_radius", "what a leg takes up: a round bar; without it no collision is looked for", '"5 mm"'),
    Key("leg_ends", "from a joint's centre to where the bar begins", '"5 mm"', needs=("leg_radius",)),
    Key(
        "base_disc",
        'the plate of the base, in its frame; centre = ["0 mm", "0 mm", "0 mm"], normal = [0, 0, 1] if not stated',
        '{ radius = "20 mm", thickness = "5 mm" }',
        needs=("leg_radius",),
    ),
    Key(
        "platform_disc",
        "the same of the platform",
        '{ radius = "20 mm", thickness = "5 mm" }',
        needs=("leg_radius",),
    ),
)
_CIRCLES = tuple(f"{plate}_{what}" for plate in ("base", "platform") for what in ("radius", "gap", "height"))

GEOMETRY: dict[str, tuple[Key, ...]] = {
    "hexapod": (
        Key("base_radius", "circle of the base's joint centres"),
        Key("base_gap", "on that circle, between the two closest joints"),
        Key("base_height", "of that circle, along z of the base frame"),
        Key("platform_radius", "the same of the platform, in its own frame"),
        Key("platform_gap", "between the two closest joints"),
        Key("platform_height", "along z of the platform's frame"),
        Key("base_joints", "joint centres one by one, leg1 first", instead=_CIRCLES, needs=("platform_joints",)),
        Key("platform_joints", "the same, in the platform's frame", instead=_CIRCLES, needs=("base_joints",)),
        *_LEGGED_KEYS,
    ),
    "tripod": (
        Key("base_joints", "joint centres in the base frame, arm1 first"),
        Key("platform_joints", "joint centres in the plate's frame"),
        Key("tool", "the tool's centre in the plate's frame", '["0 mm", "0 mm", "0 mm"]'),
        *_LEGGED_KEYS,
    ),
    "linkage": (
        Key("base_a", "hinge of actuator a, in the plane"),
        Key("base_b", "hinge of actuator b"),
        Key("offset", "from the actuators' joint to the point that is moved"),
        Key("angle", "at that joint, from actuator a to the point"),
        _HOME,
        Key("near", "lengths of a and b, where two are possible; the longer a if not stated", '["367 mm", "409 mm"]'),
    ),
    "traverser": (
        _HOME,
        Key("directions", "of X, Y and Z in the base frame, if not its axes", "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"),
        Key("length", "lever at which a turn counts as a way", '"100 mm"'),
    ),
    "arm": (
        Key("urdf", "a file beside this one"),
        Key("joints", "its three, from the base on"),
        Key("tool", "its link that is moved"),
        Key("home", "angles of the joints from which travel and pulses count"),
    ),
}


def _axis(linear: bool) -> tuple[Key, ...]:
    """The keys of [axes], with examples in the units of linear or of rotary axes."""

    def example(of_linear: str, of_rotary: str) -> str:
        return of_linear if linear else of_rotary

    ways = "two: towards smaller, towards greater positions"
    drive = Key(
        "drive",
        example(
            "a screw: steps of a revolution, and the way of one", "steps of a revolution; behind a gear: gear = 74.0"
        ),
        example('{ steps = 400, lead = "0.5 mm" }', "{ steps = 400, gear = 1.0 }"),
        instead=("pulse",),
    )
    return (
        Key("travel", "of each axis from home", example('["0 mm", "50 mm"]', '["-90 deg", "90 deg"]')),
        Key("pulse", "way of one pulse", example('"1 um"', '"0.01 deg"'), instead=("drive",)),
        drive,
        Key("electronic_gear", "(n, d): the drive makes n/d steps of each pulse", "[2, 1]"),
        Key("pulse_factor", "what a calibration found a pulse to be, over what is stated", "1.0001"),
        Key("direction", "1 or -1: how a greater position is counted", "-1"),
        Key("max_speed", f"unlimited if not stated; {ways}", example('"20 mm/s"', '"60 deg/s"')),
        Key("max_acceleration", "likewise", example('"225 mm/s^2"', '"240 deg/s^2"')),
        Key("max_jerk", "likewise; without it plans are of order 2", example('"4000 mm/s^3"', '"4000 deg/s^3"')),
        Key("max_force", "of the actuator; needs masses, below", example('"220 N"', '"10 N*m"')),
        Key(
            "torque_speed",
            "force that the motor has at rising speeds; needs masses",
            example('[["0 mm/s", "220 N"], ["50 mm/s", "80 N"]]', '[["0 deg/s", "10 N*m"], ["90 deg/s", "4 N*m"]]'),
        ),
        Key("friction", "viscous", example('"100 N*s/m"', '"0.1 N*m*s/rad"')),
        Key("reflected", "rotor and screw, as the axis feels them", example('"2 kg"', '"0.01 kg*m^2"')),
        Key("max_pulse_rate", "that the card or the drive takes", '"500 kHz"'),
        Key(
            "timing",
            'of the drive\'s inputs, by its name; or { high = "1 us", low = "1 us", setup = "1 us", hold = "1 us" }, '
            'with max_rate = "500 kHz" if it has one',
            '"DRV8825"',
        ),
        Key(
            "resonance",
            'bands in which a stepper resonates, rising: of speed, or of pulse rate as [["180 1/s", "220 1/s"]]',
            example('[["4 mm/s", "5 mm/s"]]', '[["20 deg/s", "25 deg/s"]]'),
        ),
        Key(
            "resonance_time",
            "that a stay in a band may last; never in one if not stated",
            '"20 ms"',
            needs=("resonance",),
        ),
        Key("backlash", "lost at every reversal", example('"0.01 mm"', '"0.02 deg"')),
        Key("pushed", '"+" or "-": the side on which the play is at first', '"+"'),
        Key(
            "lead_error",
            "of the screw: positions from home, rising, and how far beyond each the axis is",
            example('[["0 mm", "0 mm"], ["50 mm", "0.01 mm"]]', '[["0 deg", "0 deg"], ["90 deg", "0.01 deg"]]'),
        ),
        Key("compensate", 'what the pulses make up for: "backlash", "lead"', '["backlash"]', needs=("backlash",)),
        Key(
            "take_up_acceleration",
            "of a motor that crosses its play; max_acceleration if not stated",
            example('"500 mm/s^2"', '"500 deg/s^2"'),
        ),
    )


LINEAR, ROTARY = _axis(linear=True), _axis(linear=False)
"""Keys of [axes], by the kind of the axes."""

_INERTIA = 'inertia = ["0 kg*m^2", "0 kg*m^2", "0 kg*m^2"]'
PLATFORM = (
    Key("mass", "of what moves with the platform or the tool", '"1.5 kg"'),
    Key("centre", "of the mass, in the platform's frame", '["0 mm", "0 mm", "10 mm"]'),
    Key("inertia", "about that centre: three moments, or three rows", '["0.01 kg*m^2", "0.01 kg*m^2", "0.02 kg*m^2"]'),
    Key("force", "on the platform's origin from outside, in the base frame", '["0 N", "0 N", "-10 N"]'),
    Key("moment", "likewise", '["0 N*m", "0 N*m", "0 N*m"]'),
)
LEGS = (
    Key(
        "barrel",
        "the leg's part at the base, z along the leg from its joint",
        f'{{ mass = "0.5 kg", centre = ["0 mm", "0 mm", "50 mm"], {_INERTIA} }}',
    ),
    Key(
        "rod",
        "its part at the platform, from that joint",
        f'{{ mass = "0.1 kg", centre = ["0 mm", "0 mm", "-50 mm"], {_INERTIA} }}',
    ),
    Key("first_axis", "of the universal joint, which stands still in the base frame", "[1, 0, 0]"),
)


_LEGGED_KINDS = ("hexapod", "tripod")


def machine_starter(preset: str) -> str:
    """The text. Raises MotionError for a name that no bundled machine has."""
    data = _data(preset)
    lines = [
        f"# A machine to start from, with the numbers of {_describe_source(preset)}: put your own in their place.",
        "# A line that begins with # and no blank is a key, or a table, that may be given: take the # away.",
        "# Numbers carry their units: mm, in, deg, rad, kg, N, s, Hz and so on.",
    ]
    return "\n".join([*lines, *_tables(preset, data)]) + "\n"


def companions(preset: str) -> dict[str, bytes]:
    """What the file names beside it, such as an arm's URDF: content by name."""
    source, urdf = find("kinematics", "machine", preset), _data(preset)["geometry"].get("urdf")
    return {} if urdf is None else {urdf: (source_folder("kinematics", source) / urdf).read_bytes()}


def _describe_source(preset: str) -> str:
    source = find("kinematics", "machine", preset)
    return source.name if isinstance(source, Path) and source == Path(preset) else f'the bundled machine "{preset}"'


def _data(preset: str) -> dict[str, Any]:
    return tomllib.loads(toml_of(find("kinematics", "machine", preset)).decode())


def _tables(preset: str, data: dict[str, Any]) -> Iterator[str]:
    kind, axes = data["kind"], ROTARY if data["kind"] == "arm" else LINEAR
    names = [axis.name for axis in load_machine(preset).axes]
    yield from table_lines("", HEAD, data)
    yield from table_lines("[geometry]", _geometry(preset, kind), data["geometry"])
    own = "what all axes have" if kind != "traverser" else "what all slides have"
    yield from table_lines("[axes]", axes, data["axes"], own)
    if kind == "traverser":
        yield from table_lines(
            "[rotary]", ROTARY, data["rotary"], "the same of the turning axis, which needs no travel"
        )
    about = "what one axis has of its own: any key of [axes]; a table for each such axis"
    name = Key("name", f"of the axis: {', '.join(names)}", f'"{names[0]}"')
    for one in data.get("axis", ()):
        yield from table_lines("[[axis]]", [name, *(Key(key, "its own") for key in one if key != "name")], one, about)
    if not data.get("axis"):
        faster = next(key for key in axes if key.name == "max_speed")
        yield from table_lines("[[axis]]", [name, replace(faster, about="its own")], None, about)
    wired = [Key(axis, "card, and which of its axes", f'["PCI-8164", {n}]') for n, axis in enumerate(names)]
    yield from table_lines("[wiring]", wired, data.get("wiring"), "which motion card drives an axis")
    yield from table_lines(
        "[platform]", PLATFORM, data.get("platform"), "masses: with them max_force and torque_speed are kept"
    )
    if kind in _LEGGED_KINDS:
        yield from table_lines("[legs]", LEGS, data.get("legs"), "the two parts of every leg")


def _geometry(preset: str, kind: str) -> list[Key]:
    """The keys of a kind; where joints lie on circles, the example of joints one by one is the same joints."""
    machine = load_machine(preset)
    if not isinstance(machine, Hexapod):
        return list(GEOMETRY[kind])
    joints = {"base_joints": machine.base, "platform_joints": machine.platform}
    return [replace(key, example=_rows(joints[key.name])) if key.name in joints else key for key in GEOMETRY[kind]]


def _rows(points: Array) -> str:
    """As a comment of several lines, to a tenth of a nanometre."""
    return "[" + "".join(f"\n#    {format_millimetres(np.round(point, 10) + 0.0)}," for point in points) + "\n#]"
