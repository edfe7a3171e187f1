"""Names and help that the command line shows or completes before slow modules are loaded.

Literal data: this module imports nothing. Each entry is copied from a class or a table below, and
`tests/pulsepath/test_registries.py` compares the two. Presets are not listed here:
`pulsepath.known_names` lists their folders.
"""

TABLES = {
    "kinds": "kinematics.machine.machine_file:KINDS",
    "laws": "controllers.laws.registry:LAWS",
    "rules": "planner.pulses.generation.rules:RULES",
    "exports": "planner.export.format:FORMATS",
    "imports": "planner.sources.source:SOURCES",
}
"""Module and name of each table that a program may add its own entries to."""

Option = tuple[str, str | tuple[str, ...], str, str]
"""An option: its name, type ("quantity", a type, or one of these words), formats, help."""

EXPORTS = {
    "pulses": "Every edge of the step and direction lines, as a logic analyser records them.",
    "vcd": "Value change dump of the step and direction lines, for GTKWave and PulseView.",
    "steps": "Run-length step queue as in Klipper: commands of interval, count and add, in clock ticks.",
    "npz": "Ticks and directions of every axis as arrays, in parts, for numpy.load.",
    "binary": "The pulse schedule itself in compressed chunks, for pulsepath.read_pulses.",
    "zaber": "Zaber PVT sequence: a CSV of segment times, positions and velocities, cubic between them.",
    "xps": "Newport XPS PVT trajectory: relative moves and exit speeds, cubic between them.",
    "pmac": "PMAC motion program in PVT mode: relative moves and end speeds, cubic between them.",
    "g93": "G-code in inverse time (G93): joint axes, straight between points.",
    "ros": (
        "ROS JointTrajectory as YAML: positions, velocities, accelerations unless they jump; quintic or cubic between."
    ),
    "halstreamer": "Positions at every sample of a real-time thread, for LinuxCNC's halstreamer.",
    "csp": (
        "EtherCAT (CiA 402) cyclic synchronous position: increments, velocity and torque offsets, a row per cycle."
    ),
    "galil": "Galil contour mode: whole counts per axis and time interval.",
    "adlink": "Calls of the motion cards ADLINK PCI-8132 and PCI-8164, as C source.",
    "adlink-csv": "Calls of the motion cards ADLINK PCI-8132 and PCI-8164, as a table.",
    "kmitl-arms": "Arm-length list of the three-armed machine, step by step along the path.",
    "kmitl-positions": "Position list of the three-armed machine: poses joined by straight lines.",
    "byte": "One byte per step for a parallel port, at most four axes.",
    "sahbaz": "One trapezoidal move per axis from stop to stop, as the hexapod's own program calls the ADLINK cards.",
    "sasidhar": "Remote line protocol of the four-axis traverser: one line of steps per move between stops.",
}
"""Export formats, each with the first line of its class' docstring."""
FROM_REST = "zaber xps pmac g93 sahbaz sasidhar"
"""Export formats that cannot hold a stop, because a stop begins in motion."""
EXPORT_OPTIONS: tuple[Option, ...] = (
    (
        "width",
        "quantity",
        "pulses vcd",
        "pulse width of STEP. Default 2 us, or half the smallest interval if less",
    ),
    (
        "within",
        "quantity",
        "steps",
        "largest time error of a pulse, for longer commands. Default 1 us",
    ),
    (
        "least",
        "quantity",
        "steps",
        "smallest time between pulses of an axis. Default: as its drive requires",
    ),
    ("named", "bool", "steps", "write each number with its name, as Klipper's console takes it"),
    ("part", "int", "npz binary", "largest number of pulses per axis and part"),
    (
        "tolerance",
        "float",
        "zaber xps pmac g93 ros",
        "largest error of the reader's interpolation, in pulses; sets the spacing. Default 0.5",
    ),
    (
        "spacing",
        "quantity",
        "zaber xps pmac g93 ros",
        "fixed time between points instead; the resulting error is reported",
    ),
    (
        "origin",
        ("home", "natural"),
        "zaber g93 ros halstreamer",
        "positions from home, or natural coordinates: leg lengths and angles. Default home; ros: natural",
    ),
    (
        "letters",
        "str",
        "zaber pmac g93",
        "letters of the axes, in the machine's order. Default: their names where letters, else XYZABCUVW",
    ),
    ("step", "quantity", "zaber", "resolution of durations. Default 0.1 ms"),
    (
        "unit",
        ("mm", "counts"),
        "pmac halstreamer",
        "mm (rotary axes: deg), or counts: pulses of the wiring. Default mm",
    ),
    (
        "ros",
        ("1", "2"),
        "ros",
        "ROS version: 1 names times secs and nsecs, 2 sec and nanosec. Default 2",
    ),
    ("period", "quantity", "halstreamer", "period of the real-time thread. Default 1 ms"),
    ("cycle", "quantity", "csp", "cycle time of the fieldbus, 0.25 to 4 ms. Default 1 ms"),
    ("increments", "int", "csp", "increments of the drive per pulse of the machine. Default 1"),
    (
        "rated",
        "str",
        "csp",
        "N or N m at the axis at the motor's rated torque, one number or one per axis: adds torque offsets",
    ),
    ("interval", "int", "galil", "n of DT, for intervals of 2^n ms: 1 to 8. Default 1"),
    (
        "spacing",
        "quantity",
        "adlink adlink-csv",
        "time between calls of an axis. Default: the longest with an error of 1 pulse",
    ),
    (
        "speed_range",
        "quantity",
        "adlink adlink-csv",
        "full scale of the cards' speed registers. Default: as the motion needs",
    ),
    (
        "point_step",
        "quantity",
        "kmitl-arms",
        "distance between listed points along the path. Default 1 mm",
    ),
    ("unit_length", "quantity", "kmitl-arms kmitl-positions", "length of one unit. Default 1 mm"),
    (
        "chord",
        "quantity",
        "kmitl-positions",
        "largest deviation from the path of the straight lines between poses. Default 0.01 mm",
    ),
)

IMPORTS = {
    "dxf": (
        "DXF drawings: lines, arcs, circles, polylines, ellipses, splines, blocks. Texts and the like are skipped."
    ),
    "gcode": (
        "G-code (RS-274): lines, arcs, canned cycles and subprograms; other words are refused with line and column."
    ),
    "positions": "Position lists: CSV with units, and the position and arm-length files of the three-armed machine.",
}
"""Formats that programs come in, likewise."""
SUFFIXES = {
    ".dxf": "dxf",
    ".ngc": "gcode",
    ".nc": "gcode",
    ".gcode": "gcode",
    ".tap": "gcode",
    ".cnc": "gcode",
    ".csv": "positions",
    ".txt": "positions",
}
"""Import formats by the suffixes of their files."""
IMPORT_OPTIONS: tuple[Option, ...] = (
    ("length", "str", "dxf", 'unit of the drawing, as "mm". Default: as the drawing states'),
    (
        "layers",
        "str",
        "dxf",
        'only these layers, as "CUT, MARK". Default: all that are on and not frozen',
    ),
    ("skip", "str", "dxf", 'layers to leave out, as "NOTES, 0"'),
    ("tolerance", "quantity", "dxf", "ends this close are joined. Default 0.01 mm"),
    (
        "deviation",
        "quantity",
        "dxf",
        "largest deviation from ellipses and splines. Default 0.001 mm",
    ),
    (
        "order",
        ("nearest", "file"),
        "dxf",
        "order of contours: nearest shortens the moves between them, file keeps the drawing's. Default nearest",
    ),
    (
        "join",
        ("through", "stop"),
        "dxf",
        "joins inside contours: through passes smooth joins, stop rests. Default through",
    ),
    (
        "blend",
        "quantity",
        "dxf gcode positions",
        'round joins within this tolerance instead, as "0.05 mm"',
    ),
    (
        "fit",
        "quantity",
        "dxf gcode positions",
        'fit smooth curves within this tolerance instead, as "0.02 mm"',
    ),
    ("speed", "quantity", "dxf", "limit of the tool speed along contours. Default: none"),
    ("rapid", "quantity", "dxf", "limit of the tool speed between contours. Default: none"),
    (
        "retract",
        "quantity",
        "dxf",
        "height of moves between contours above the drawing's plane. Default: in the plane",
    ),
    (
        "approach",
        "quantity",
        "dxf",
        "height above a contour's start from which the tool descends at speed. Default 0",
    ),
    (
        "lead_in",
        "quantity",
        "dxf",
        "length of a tangential lead-in to closed contours. Default: none",
    ),
    (
        "lead",
        ("line", "arc"),
        "dxf",
        "shape of the lead-in: straight, or a quarter circle. Default line",
    ),
    ("side", ("outside", "inside"), "dxf", "side of a quarter-circle lead-in. Default outside"),
    (
        "origin",
        "str",
        "dxf",
        'position of the drawing\'s zero from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home',
    ),
    (
        "strict",
        "bool",
        "dxf",
        "refuse texts, dimensions, points and hatches instead of skipping them with a warning",
    ),
    (
        "join",
        ("through", "stop"),
        "gcode",
        "joins until G61, G61.1 or G64: through passes smooth joins, stop rests. Default through",
    ),
    ("rapid", "quantity", "gcode", "limit of the tool speed on G0. Default: none"),
    (
        "feed",
        "quantity",
        "gcode",
        "limit of the tool speed before the first F. Default: F is required",
    ),
    ("length", ("mm", "in"), "gcode", "unit before G20 or G21. Default mm"),
    (
        "arc_tolerance",
        "quantity",
        "gcode",
        "largest difference of an arc's radii at its ends. Default: that of rounded coordinates",
    ),
    (
        "block_delete",
        ("skip", "run"),
        "gcode",
        "skip or run blocks that begin with /. Default: refuse them",
    ),
    ("dwell", ("s", "ms"), "gcode", "unit of P of G4. Default s"),
    (
        "origin",
        "str",
        "gcode",
        'position of the file\'s zero from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home',
    ),
    ("ignore", "str", "gcode", 'further words to skip with their arguments, as "M48 M205 G43"'),
    (
        "strict",
        "bool",
        "gcode",
        "refuse spindle, coolant and tool words instead of marking or skipping them",
    ),
    (
        "machine",
        "str",
        "gcode",
        "for a file of joint axes, as written by the export g93: the machine it is for",
    ),
    ("length", "str", "positions", 'unit of columns x, y, z without a unit, as "mm"'),
    ("angle", "str", "positions", 'unit of angle columns without a unit, as "deg"'),
    (
        "rotation",
        ("xyz", "yzx"),
        "positions",
        "rotation order: xyz is Rx·Ry·Rz, yzx Ry·Rz·Rx. Default: as the file states, else xyz",
    ),
    (
        "frame",
        ("home", "base"),
        "positions",
        "frame of the coordinates. Default: as the file states, else home",
    ),
    ("first", "int", "positions", "number of the first pose to run. Default 1"),
    ("last", "int", "positions", "number of the last pose to run. Default: the last in the list"),
    (
        "rule",
        ("optimal", "kmitl"),
        "positions",
        "optimal: straight lines between poses; kmitl: unit steps with a rest after each. Default optimal",
    ),
    (
        "unit_length",
        "quantity",
        "positions",
        "length of one unit of the three-armed machine. Default 1 mm",
    ),
    (
        "join",
        ("through", "stop"),
        "positions",
        "joins of rule optimal: through passes smooth joins, stop rests. Default through",
    ),
    ("speed", "quantity", "positions", "cap of the tool's speed. Default: none"),
    (
        "dwell",
        "quantity",
        "positions",
        'dwell at every pose, as "0.2 s". Default: the file\'s column dwell',
    ),
    (
        "tool",
        "str",
        "positions",
        "the tool's frame in the platform's, as \"0 mm, 0 mm, -50 mm\". Default: none",
    ),
    ("arms", "str", "positions", "machine of a file of the three-armed machine. Default tripod"),
)

NAMES: dict[str, tuple[str, ...]] = {
    "kinds": ("hexapod", "tripod", "linkage", "traverser", "arm", "equations"),
    "laws": (
        *("1", "open-velocity"),
        *("2", "open-velocity-sleep"),
        *("3", "open-position"),
        *("3o", "open-position-trapezoid"),
        *("3t", "closed-position-trapezoid"),
        *("4", "closed-error"),
        *("5", "closed-error-speed"),
        *("6", "closed-position"),
        *("7", "closed-position-relative"),
        *("6r", "closed-position-repaired"),
        *("7r", "closed-position-relative-repaired"),
        *("ff", "feedforward"),
        *("mpc", "predictive"),
    ),
    "rules": ("nearest", "floor", "sampled", "dda", "timer"),
    "exports": (*EXPORTS,),
    "imports": (*IMPORTS,),
}
"""The words in the keys of each table."""
CONTROLLERS = {
    "linuxcnc": "halstreamer",
    "ethercat": "csp",
    "klipper": "steps --named",
    "grbl": "g93",
    "grblhal": "g93",
    "fluidnc": "g93",
    "ros2": "ros",
    "newport": "xps",
    "csv": "pulses",
}
"""The export format, with its options, of controllers that people ask for by their own names."""
